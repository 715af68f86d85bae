"""`legato up --compose` and `legato down --compose`: what they say to `docker compose`."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path

from client.commands import Up
from common.errors import InvalidValue, MissingProgram, UnknownName
from common.robots import list_robots

ALWAYS = ("abstract", "panda")
"""Robots whose retargeters compose.yaml starts without a profile."""
_OWN = ("namespace", "data", "certs", "log_level", "metrics_port", "foreground")
"""Options of processes that compose.yaml does not know."""


def compose_up(command: Up) -> int:
    """Start the containers of the current folder and wait until they are ready.

    Returns:
        The exit code of `docker compose`, which says itself what went wrong.

    Raises:
        InvalidValue: An option that containers do not have, or no compose.yaml here.
        MissingProgram: There is no docker.
        UnknownName: There is no such robot.
    """
    for option in _OWN:
        if getattr(command, option) != getattr(Up(), option):
            expected = "no such option with --compose; see docs/deployment.md"
            raise InvalidValue(
                f"--{option.replace('_', '-')}", str(getattr(command, option)), expected
            )
    for robot in command.robot:
        if robot not in list_robots():
            raise UnknownName("robot", robot, list_robots())
    arguments = ("up", "--wait", "--scale", f"sim={command.cells}")
    return _compose(arguments, environment=_environment(command))


def compose_down() -> int:
    """Stop the containers of the current folder, of every profile.

    Raises:
        InvalidValue: No compose.yaml here.
        MissingProgram: There is no docker.
    """
    return _compose(("--profile=*", "down"), environment={})


def _environment(command: Up) -> dict[str, str]:
    """What the options mean to compose.yaml; what is not asked for stays as the shell has it."""
    values: dict[str, str] = {}
    if further := [robot for robot in command.robot if robot not in ALWAYS]:
        given = os.environ.get("COMPOSE_PROFILES", "")
        values["COMPOSE_PROFILES"] = ",".join([*filter(None, [given]), *further])
    if command.port != Up().port:
        values["LEGATO_PORT"] = str(command.port)
    if command.router_port != Up().router_port:
        values["LEGATO_ROUTER"] = f"127.0.0.1:{command.router_port}"
    if command.checkpoints is not None:
        values["LEGATO_CHECKPOINTS"] = str(command.checkpoints.resolve())
    if command.lease_s is not None:
        values["LEGATO_LEASE_S"] = str(command.lease_s)
    return values


def _compose(arguments: tuple[str, ...], *, environment: Mapping[str, str]) -> int:
    if not Path("compose.yaml").is_file():
        raise InvalidValue("--compose", str(Path.cwd()), "a folder with LEGATO's compose.yaml")
    docker = shutil.which("docker")
    if docker is None:
        raise MissingProgram("docker", "Docker with Compose 2.24 or later")
    done = subprocess.run([docker, "compose", *arguments], env={**os.environ, **environment})
    return done.returncode
