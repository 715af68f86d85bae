"""Robots looked at inside this process, without services or a simulation.

The kinematics and the checks are imported when they are used.
"""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from common.errors import BadRobotFile, MissingExtra
from common.robots import RobotSpec, list_robots, load_robot

if TYPE_CHECKING:
    from services.retarget.check.report import RobotReport
    from services.retarget.check.robot import RobotSummary


def find_robot(robot: str) -> RobotSpec:
    """Read a robot that ships with LEGATO, or one from any folder.

    Args:
        robot: Its name, or the path of a folder with model.xml and robot.toml.

    Raises:
        UnknownName: Neither a robot nor a folder.
        BadRobotFile: A file is missing or wrong.
    """
    folder = Path(robot).resolve()
    if robot in list_robots() or not folder.is_dir():
        return load_robot(robot)
    if not (folder / "robot.toml").is_file():
        raise BadRobotFile(folder.name, "robot.toml", "the file is missing")
    return load_robot(folder.name, folder=folder.parent)


def check_robot(spec: RobotSpec) -> RobotReport:
    """Check one robot.

    Raises:
        ModelError: A file of which nothing can be made; names the body or joint.
        MissingExtra: A package is not installed.
    """
    with _extra_installed():
        from services.retarget.check import robot

        return robot.check_robot(spec)


def summarize_robot(spec: RobotSpec) -> RobotSummary:
    """One robot in few words.

    Raises:
        ModelError: A file of which nothing can be made; names the body or joint.
        MissingExtra: A package is not installed.
    """
    with _extra_installed():
        from services.retarget.check import robot

        return robot.summarize_robot(spec)


@contextmanager
def _extra_installed() -> Generator[None]:
    try:
        yield
    except ModuleNotFoundError as error:
        raise MissingExtra(error.name or "of the retargeter", "retarget") from error
