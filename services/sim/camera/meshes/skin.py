"""Meshes on a compiled model: which bodies carry them, and which geoms they stand for."""

from __future__ import annotations

import copy
from dataclasses import dataclass

import mujoco

from common.se3 import Array
from services.sim.camera.meshes.hull import Hull
from services.sim.camera.shapes import HIDDEN_GROUPS, Integers


@dataclass(frozen=True, eq=False)
class Skin:
    """Meshes that a scene renderer shows in place of geoms.

    Args:
        hull: Triangles of s shells, n in all.
        albedo: (n, 3) of the triangles: red, green, blue from 0 to 1.
        bodies: (s,) id of the body that carries each shell.
        hidden: (h,) ids of the geoms that are not shown.
    """

    hull: Hull
    albedo: Array
    bodies: Integers
    hidden: Integers

    def uncover(self, model: mujoco.MjModel) -> mujoco.MjModel:
        """A copy of the model in which no camera sees the hidden geoms."""
        bare = copy.copy(model)
        bare.geom_group[self.hidden] = HIDDEN_GROUPS[0]
        return bare
