"""The fixed rays of a calibrated lens, in tiles.

Ray positions form a lattice of one ray per pixel, plus one column and one row past the picture so
that every pixel lies between coarse ones. Even columns and rows are the coarse grid.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from common.calibration import StereoCalibration
from common.se3 import Array
from services.sim.camera.pyramids import Bundles, bound_directions
from services.sim.camera.shapes import Integers, Mask

Flags: TypeAlias = npt.NDArray[np.uint8]

Scalar = TypeVar("Scalar", bound=np.generic)

TILE_PX = 16
"""Edge of a tile, even. Larger tiles share more work, smaller ones meet fewer shapes."""

MOST_RAYS = (TILE_PX + 1) ** 2
"""In one tile: the last ones also take the lattice's extra column and row."""


class Lens(NamedTuple):
    """Tables of a lens.

    Args:
        rays: (rows, columns, 3) unit vectors in the camera frame, on the lattice.
        inside: (height, width) 1 for pixels inside the image circle.
        coarse: (r, c) 1 for coarse places that a pixel inside the circle needs.
        tiles: (t, 4) first row, end row, first column, end column of each tile on the lattice.
        axes: (t, 3, 3) frames of the tiles, and
        bounds: (t, 4) extents of their rays, see `pyramids.Bundles`.
        ray_angle_rad: Angle between neighbouring rays near the axis.
    """

    rays: Array
    inside: Flags
    coarse: Flags
    tiles: Integers
    axes: Array
    bounds: Array
    ray_angle_rad: float


@lru_cache(maxsize=4)
def build_lens(calibration: StereoCalibration) -> Lens:
    """Tables of a calibrated lens, read-only (kept: every episode of a run uses the same)."""
    height, width = calibration.height, calibration.width
    cells = ((height + 1) // 2, (width + 1) // 2)
    rows, columns = np.indices((2 * cells[0] + 1, 2 * cells[1] + 1), dtype=np.float64)
    rays = calibration.ray_directions(columns + 0.5, rows + 0.5)
    inside = ~calibration.outside_circle()
    on_lattice = np.zeros(rays.shape[:2], dtype=np.bool_)
    on_lattice[:height, :width] = inside
    coarse = _coarse_needed(on_lattice)
    u, v = calibration.center_px
    pair = calibration.ray_directions(np.array([u, u + 1.0]), np.array([v, v]))
    ray_angle_rad = float(np.arctan2(pair[1, 0], pair[1, 2]))
    needed = on_lattice.copy()
    needed[::2, ::2] |= coarse
    return _make_lens(rays, inside, coarse, needed, ray_angle_rad)


@lru_cache(maxsize=2)
def build_pinhole(width: int, height: int, fovy_deg: float) -> Lens:
    """Tables of an ideal lens without coarse grid: r = f tan(theta), 2 f tan(fovy/2) = height."""
    focal = 0.5 * height / math.tan(math.radians(fovy_deg) / 2.0)
    rows, columns = np.indices((height, width), dtype=np.float64)
    x, y = columns + (0.5 - 0.5 * width), rows + (0.5 - 0.5 * height)
    length = np.sqrt(x * x + y * y + focal * focal)
    rays = np.stack([x / length, y / length, focal / length], axis=-1)
    everywhere = np.ones((height, width), dtype=np.bool_)
    return _make_lens(rays, everywhere, np.zeros((0, 0)), everywhere, 1.0 / focal)


def freeze(array: npt.NDArray[Scalar]) -> npt.NDArray[Scalar]:
    """Make an array read-only: the kernel takes lenses with read-only tables only."""
    array.flags.writeable = False
    return array


def _make_lens(
    rays: Array, inside: Mask, coarse: Mask | Array, needed: Mask, ray_angle_rad: float
) -> Lens:
    tiles, bundles = _cut(rays, needed)
    return Lens(
        rays=freeze(rays),
        inside=freeze(inside.astype(np.uint8)),
        coarse=freeze(coarse.astype(np.uint8)),
        tiles=freeze(tiles),
        axes=freeze(bundles.axes),
        bounds=freeze(bundles.bounds),
        ray_angle_rad=ray_angle_rad,
    )


def _coarse_needed(inside: Mask) -> Mask:
    """Coarse places that are a corner of a cell with at least one pixel inside the circle."""
    used = inside[:-1:2, :-1:2] | inside[1::2, :-1:2] | inside[:-1:2, 1::2] | inside[1::2, 1::2]
    corner = np.zeros((used.shape[0] + 1, used.shape[1] + 1), dtype=np.bool_)
    for rows in (slice(None, -1), slice(1, None)):
        for columns in (slice(None, -1), slice(1, None)):
            corner[rows, columns] |= used
    return corner


def _cut(rays: Array, needed: Mask) -> tuple[Integers, Bundles]:
    """Tiles with at least one needed ray, and their bounds."""
    tiles: list[tuple[int, int, int, int]] = []
    bundles: list[Array] = []
    for top, bottom in _edges(needed.shape[0]):
        for left, right in _edges(needed.shape[1]):
            chosen = needed[top:bottom, left:right]
            if chosen.any():
                tiles.append((top, bottom, left, right))
                bundles.append(rays[top:bottom, left:right][chosen])
    starts = np.cumsum([0, *(len(bundle) for bundle in bundles)]).astype(np.int64)
    directions = np.concatenate([np.empty((0, 3)), *bundles])
    return np.array(tiles, dtype=np.int64).reshape(-1, 4), bound_directions(directions, starts)


def _edges(size: int) -> list[tuple[int, int]]:
    """First and end of each tile along one edge of a lattice; the last may be one larger."""
    count = max(1, -((1 - size) // TILE_PX))
    firsts = [k * TILE_PX for k in range(count)]
    return list(zip(firsts, [*firsts[1:], size], strict=True))
