"""One folder per robot: model.xml (MJCF) and robot.toml. `load_robot` reads and checks them."""

from __future__ import annotations

from common.robots.loader import list_robots, load_robot
from common.robots.spec import (
    BodyMeshSpec,
    CollisionSpec,
    FixedJointSpec,
    HandServo,
    HeadSpec,
    JointSpec,
    LegSpec,
    MeshesSpec,
    RetargetSpec,
    RobotSpec,
    WallSpec,
)

__all__ = [
    "BodyMeshSpec",
    "CollisionSpec",
    "FixedJointSpec",
    "HandServo",
    "HeadSpec",
    "JointSpec",
    "LegSpec",
    "MeshesSpec",
    "RetargetSpec",
    "RobotSpec",
    "WallSpec",
    "list_robots",
    "load_robot",
]
