"""Find and read the robots that ship with LEGATO."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from common.errors import BadRobotFile, UnknownName
from common.robots.spec import RobotSpec

ROBOTS_FOLDER = Path(__file__).parent


def list_robots() -> list[str]:
    """Names of all robots: the folders that have a robot.toml."""
    return sorted(path.parent.name for path in ROBOTS_FOLDER.glob("*/robot.toml"))


def load_robot(name: str, *, folder: Path = ROBOTS_FOLDER) -> RobotSpec:
    """Read one robot's robot.toml.

    Args:
        name: Folder name, e.g. `panda`.
        folder: Where the robot folders are.

    Raises:
        UnknownName: No such robot.
        BadRobotFile: A file is missing, is not TOML, or has a wrong or unknown entry.
    """
    path = folder / name / "robot.toml"
    if not path.is_file():
        raise UnknownName("robot", name, list_robots())
    if not path.with_name("model.xml").is_file():
        raise BadRobotFile(name, "model.xml", "the file is missing")
    try:
        fields = tomllib.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise BadRobotFile(name, "robot.toml", str(error)) from error
    try:
        return RobotSpec.model_validate({"name": name, "folder": path.parent, **fields})
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        element = ".".join(str(part) for part in first["loc"]) or "robot.toml"
        raise BadRobotFile(name, element, first["msg"] + _whose(first["loc"], fields)) from error


def _whose(place: tuple[int | str, ...], fields: Mapping[str, Any]) -> str:
    """The name of the joint, leg or wall that an entry belongs to, to be added to a message."""
    match place:
        case (str(table), int(index), *_):
            match fields[table][index]:
                case {"name": str(name)}:
                    return f" (of {name})"
                case _:
                    return ""
        case _:
            return ""
