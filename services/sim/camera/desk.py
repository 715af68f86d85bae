"""Room for the pictures of one camera."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from common.se3 import Array
from services.sim.camera.lens import Flags, Lens
from services.sim.camera.pyramids import PYRAMID_ROWS
from services.sim.camera.shading import display_table
from services.sim.camera.shapes import Integers
from services.sim.camera.tables import Scene

PLAIN_LIGHT, PATTERN_TONE = 0, 1
"""Layers of `Desk.light`."""


class Desk(NamedTuple):
    """Room for the pictures of one camera.

    Args:
        pictures: (eyes, height, width) the result in shades of gray, as bytes.
        pyramids: (t, 10, 3) of the tiles, in the world.
        candidates: (t, 1 + g) what each tile may meet, from the eye in turn, see `culling`.
        surface: (r, c) what the coarse grid sees; with a full grid, what every pixel sees.
        light: (2, r, c) there: intensity without pattern and tone of the pattern; with a full grid
            light factor and tone.
        bytes_of: (65537,) see `shading.display_table`.
    """

    pictures: Flags
    pyramids: Array
    candidates: Integers
    surface: Integers
    light: Array
    bytes_of: Flags


def make_desk(lens: Lens, scene: Scene, *, eyes: int, full_grid: bool) -> Desk:
    """Room for pictures of this scene through this lens."""
    tiles, grid = len(lens.tiles), lens.inside.shape if full_grid else lens.coarse.shape
    return Desk(
        pictures=np.zeros((eyes, *lens.inside.shape), dtype=np.uint8),
        pyramids=np.zeros((tiles, PYRAMID_ROWS, 3)),
        candidates=np.zeros((tiles, 1 + len(scene.shapes)), dtype=np.int64),
        surface=np.zeros(grid, dtype=np.int64),
        light=np.zeros((2, *grid)),
        bytes_of=display_table(),
    )
