"""A model as the kernel sees it: what it looks like, where it is, and room to work in."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from common.se3 import Array
from services.sim.camera.pyramids import PYRAMID_ROWS
from services.sim.camera.rays import make_marks, make_rays
from services.sim.camera.shapes import Integers, Table, collect_shapes
from services.sim.camera.surfaces import collect_surfaces
from services.sim.camera.views import SIGHT, VIEWS

TILE, LIGHT_DOWN = 0, 1
"""Frames in `Scene.frames`."""

CELLS_TO_A_SIDE = 24
"""Of the middle of the light's grid, see `shadows`."""

CELLS = (2 * CELLS_TO_A_SIDE) ** 2 + 1
"""Of the light's grid, and the one for all points beside it."""


class Scene(NamedTuple):
    """Tables of one model with g drawable geoms, and room for one picture at a time.

    Nothing is carried from one picture to the next: all but `surfaces` is filled anew.

    Args:
        shapes: (g,) `SHAPE` records.
        surfaces: (2 g + 1,) `SURFACE` records.
        views: (VIEWS, g) `SIGHT` records.
        rays, marks: Bundles, see `rays`.
        frames: (2, 3, 3) room for the frame of a tile, and the frame of the light.
        light_pyramid: (1, 10, 3) room for the pyramid of a cell of the light's grid.
        light_cells: (cells, 1 + g) how many shapes may stand in each cell, -1 where that is not yet
            known, and which, the nearest to the light first.
    """

    shapes: Table
    surfaces: Table
    views: Table
    rays: Array
    marks: Integers
    frames: Array
    light_pyramid: Array
    light_cells: Integers


def make_scene(model: mujoco.MjModel, *, most: int) -> Scene:
    """Tables of a model, with room for bundles of at most so many rays.

    Raises:
        UnsupportedGeom: A visible geom is of a kind without a formula.
    """
    shapes = collect_shapes(model)
    return Scene(
        shapes=shapes,
        surfaces=collect_surfaces(model, shapes),
        views=np.zeros((VIEWS, len(shapes)), dtype=SIGHT),
        rays=make_rays(most),
        marks=make_marks(most),
        # The light looks down: across is x, down in its view is -y.
        frames=np.stack([np.eye(3), np.diag([1.0, -1.0, -1.0])]),
        light_pyramid=np.zeros((1, PYRAMID_ROWS, 3)),
        light_cells=np.zeros((CELLS, 1 + len(shapes)), dtype=np.int64),
    )
