"""What success tests and scripts ask of poses."""

from __future__ import annotations

import math

from common.se3 import Array, exp3, make_pose


def upright(x: float, y: float, z: float, yaw_rad: float) -> Array:
    """Pose (4, 4) at a point [m], turned about the vertical only."""
    return make_pose(exp3([0.0, 0.0, yaw_rad]), [x, y, z])


def yaw_of(T: Array) -> float:
    """Heading of the pose's x axis in the horizontal plane [rad]."""
    return math.atan2(T[1, 0], T[0, 0])


def tilt_of(T: Array) -> float:
    """Angle between the z axes of the two frames of a pose [rad]."""
    return math.acos(max(-1.0, min(1.0, float(T[2, 2]))))


def shifted(T_world_tool: Array, *, up: float = 0.0, back: float = 0.0) -> Array:
    """The pose moved up, and back along the horizontal part of the finger direction [m]."""
    heading = yaw_of(T_world_tool)
    T = T_world_tool.copy()
    T[:3, 3] += (-back * math.cos(heading), -back * math.sin(heading), up)
    return T


def norm(v: Array) -> float:
    """Length of a vector."""
    return math.hypot(*v.tolist())
