"""One folder per robot: model.xml (MJCF) and robot.toml. `load_robot` reads and checks them."""

from __future__ import annotations

from common.robots.loader import list_robots, load_robot
from common.robots.spec import HandServo, JointSpec, RetargetSpec, RobotSpec

__all__ = [
    "HandServo",
    "JointSpec",
    "RetargetSpec",
    "RobotSpec",
    "list_robots",
    "load_robot",
]
