"""Meshes on a robot in its world, for pictures that people look at."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np

from common.robots import RobotSpec
from common.robots.meshes import load_shells
from common.se3 import Array
from services.sim.camera.meshes import Hull, Skin, pack
from services.sim.camera.shading import albedo_of_colors
from services.sim.world import World

_PREFIX = "robot_"
"""Of the robot's names in a world."""


def dress(world: World, folder: Path) -> Skin:
    """Put meshes on a world's robot, in place of the primitives of the bodies that have some.

    Args:
        world: Its robot has a table [meshes] in robot.toml.
        folder: A copy of MuJoCo Menagerie, or a folder with the same layout.

    Raises:
        BadMeshes: Table, folder, file or body is missing, or cannot be shown.
        MeshesDoNotFit: The meshes would not move as the robot does.
    """
    # A frozen pydantic model has a hash, which type checkers do not know.
    hull, albedo, names = _load(world.robot, folder)  # pyright: ignore[reportArgumentType]
    model, meshes = world.model, world.robot.meshes
    bodies = np.array([model.body(_PREFIX + name).id for name in names], dtype=np.int64)
    kept = [model.geom(_PREFIX + name).id for name in (meshes.keep if meshes else ())]
    covered = np.isin(model.geom_bodyid, bodies)
    covered[kept] = False
    return Skin(hull, albedo, bodies, np.flatnonzero(covered))


@lru_cache(maxsize=8)
def _load(robot: RobotSpec, folder: Path) -> tuple[Hull, Array, tuple[str, ...]]:
    """Triangles, their albedo and the bodies that carry them (kept: reading takes seconds)."""
    shells = load_shells(robot, folder)
    hull, colors = pack(shells)
    return hull, albedo_of_colors(colors), tuple(shell.body for shell in shells)
