"""A leg that follows the body: where its joints must be for the foot to stay on its foothold."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np

from common.errors import BadRobotFile, FootholdOutOfReach
from common.robots.spec import LegSpec, RobotSpec
from common.se3 import Array

_AXES = {"hip roll": (1.0, 0.0, 0.0), "hip pitch": (0.0, 1.0, 0.0), "knee": (0.0, 1.0, 0.0)}
_WHOLE_TURN_RAD = 2.0 * math.pi


@dataclass(frozen=True, kw_only=True)
class Leg:
    """Geometry of a leg with hip roll q0 (about x), hip pitch q1 and knee q2 (both about y).

    In body axes, with Rx and Ry rotations about x and y, the foot's centre is at

        p_body_foot = p_body_hip + Rx(q0) [(0, d, 0) + Ry(q1) [t + Ry(q2) s]]

    with the thigh t and the shank s in the plane of the leg: t_y = s_y = 0.
    """

    name: str
    joints: tuple[str, str, str]
    p_body_hip: Array
    """A point (3,) of the hip roll axis [m]."""
    lateral_m: float
    """d: hip pitch axis from the hip roll axis, along y, positive to the left."""
    thigh_m: tuple[float, float]
    """x and z of t: from the hip pitch axis to the knee, all joints at zero."""
    shank_m: tuple[float, float]
    """x and z of s: from the knee to the foot's centre, all joints at zero."""
    ranges_rad: tuple[tuple[float, float], ...]
    """Lower and upper limit of each joint."""
    p_world_foot: Array
    """The foothold (3,): where the foot's centre stands [m]."""

    @classmethod
    def from_model(cls, mj: Any, spec: LegSpec, *, robot: str) -> Self:
        """Read the geometry from a compiled robot, so that no figure exists twice.

        Args:
            mj: Compiled MuJoCo model of the robot, alone.
            spec: The leg's entry in robot.toml.
            robot: The robot's name, for error messages.

        Raises:
            BadRobotFile: The bodies and joints are not those of such a leg.
        """
        joints = [mj.joint(name) for name in spec.joints]
        bodies = [int(joint.bodyid[0]) for joint in joints]
        foot = mj.site(spec.foot_site)
        hip, lateral, thigh = (tuple(mj.body_pos[body].tolist()) for body in bodies)
        shank = tuple(foot.pos.tolist())
        _check_joints(mj, joints, robot, spec)
        chain = [*mj.body_parentid[bodies[1:]].tolist(), int(foot.bodyid[0])]
        conditions = {
            "hip, thigh, shank and foot do not follow each other": chain == bodies,
            "a body is turned in its parent": (mj.body_quat[bodies] == [1, 0, 0, 0]).all(),
            "the hip is not offset along y alone": lateral[0] == lateral[2] == 0.0,
            "thigh or shank leaves the plane of the leg": thigh[1] == shank[1] == 0.0,
            "thigh or shank has no length": any(thigh) and any(shank),
        }
        for problem, holds in conditions.items():
            if not holds:
                raise BadRobotFile(robot, f"leg {spec.name}", problem)
        return cls(
            name=spec.name,
            joints=spec.joints,
            p_body_hip=np.array(hip),
            lateral_m=lateral[1],
            thigh_m=(thigh[0], thigh[2]),
            shank_m=(shank[0], shank[2]),
            ranges_rad=tuple(tuple(mj.jnt_range[joint.id].tolist()) for joint in joints),
            p_world_foot=np.array(spec.foothold),
        )

    @cached_property
    def _segments(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Length [m] and angle [rad] of thigh and shank."""
        return _hanging(self.thigh_m), _hanging(self.shank_m)

    def solve(self, p_world_body: Array, R_world_body: Array) -> tuple[float, float, float]:
        """Hip roll, hip pitch and knee [rad] that put the foot on its foothold, knee backwards.

        With v = p_body_foot - p_body_hip = Rx(q0) (x, d, -w), the roll keeps v_x and the length:

            x = v_x,  w = sqrt(v_y^2 + v_z^2 - d^2),  q0 = atan2(v_z, v_y) - atan2(-w, d)

        taking w > 0, the foot below the hip pitch axis. Write u(a) = -(sin a, cos a) for the
        downward direction in the (x, z) plane, turned by a about y; then t = L1 u(b1) and
        s = L2 u(b2). With a = q1 + b1 and k = q2 + b2 - b1 what is left is a planar two-bar leg,

            (x, -w) = L1 u(a) + L2 u(a + k)

        whose length gives k and whose direction gives a:

            x^2 + w^2 = L1^2 + L2^2 + 2 L1 L2 cos k,  k < 0
            a = atan2(-x, w) - atan2(L2 sin k, L1 + L2 cos k)

        Args:
            p_world_body: (3,) position [m] of the body that carries the hip.
            R_world_body: (3, 3) its rotation.

        Raises:
            FootholdOutOfReach: The foothold is too near or too far, or a joint limit is exceeded.
        """
        p_body_foot = (self.p_world_foot - p_world_body) @ R_world_body
        x, y, z = (p_body_foot - self.p_body_hip).tolist()
        d = self.lateral_m
        w_squared = y * y + z * z - d * d
        if w_squared <= 0.0:
            raise FootholdOutOfReach(self.name, (x, y, z), "it is beside the hip, not below it")
        w = math.sqrt(w_squared)
        (L1, b1), (L2, b2) = self._segments
        cos_k = (x * x + w_squared - L1 * L1 - L2 * L2) / (2.0 * L1 * L2)
        if abs(cos_k) > 1.0:
            reach = f"{abs(L1 - L2):.3f} to {L1 + L2:.3f} m"
            problem = f"it is {math.hypot(x, w):.3f} m away where the leg spans {reach}"
            raise FootholdOutOfReach(self.name, (x, y, z), problem)
        k = -math.acos(cos_k)
        a = math.atan2(-x, w) - math.atan2(L2 * math.sin(k), L1 + L2 * cos_k)
        q0 = math.remainder(math.atan2(z, y) - math.atan2(-w, d), _WHOLE_TURN_RAD)
        q = (q0, a - b1, k + b1 - b2)
        for joint, value, (lower, upper) in zip(self.joints, q, self.ranges_rad, strict=True):
            if not lower <= value <= upper:
                problem = f"{joint} would be at {value:.3f}, outside {lower:.3f} to {upper:.3f} rad"
                raise FootholdOutOfReach(self.name, (x, y, z), problem)
        return q


def read_legs(mj: Any, robot: RobotSpec) -> tuple[Leg, ...]:
    """All legs of a robot, from its compiled MuJoCo model, alone.

    Raises:
        BadRobotFile: A leg is not built as `Leg` assumes.
    """
    return tuple(Leg.from_model(mj, leg, robot=robot.name) for leg in robot.legs)


def _hanging(segment_m: tuple[float, float]) -> tuple[float, float]:
    """Length L [m] and angle b [rad] of a segment (x, z) = -L (sin b, cos b)."""
    x, z = segment_m
    return math.hypot(x, z), math.atan2(-x, -z)


def _check_joints(mj: Any, joints: Sequence[Any], robot: str, spec: LegSpec) -> None:
    for (what, axis), joint in zip(_AXES.items(), joints, strict=True):
        conditions = {
            f"the {what} does not turn about its axis": tuple(joint.axis) == axis,
            f"the {what} is not at its body's origin": not joint.pos.any(),
            f"the {what} has no range": bool(mj.jnt_limited[joint.id]),
        }
        for problem, holds in conditions.items():
            if not holds:
                raise BadRobotFile(robot, f"leg {spec.name}", problem)
