"""The rays of a calibrated lens and the adaptive scheme that traces only some of them.

Ray positions form a lattice of one ray per pixel, plus one column and one row past the picture so
that every pixel lies between traced ones. Even columns and rows are the coarse grid. Four coarse
neighbours make a cell. The pixels between lie in a gap between two of them or in a cell's middle.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import numpy.typing as npt

from common.calibration import StereoCalibration
from common.se3 import Array
from services.sim.camera.bundles import Indices, order_by_tile

TILE_PX = 24

Number = TypeVar("Number", bound=np.generic)


class PixelGrid:
    """Index tables from lattice to pictures, all fixed by the calibration.

    Attributes:
        directions: (n, 3) unit vectors in the camera frame of all rays that are ever needed.
        tile: (n,) tile of each ray, not decreasing.
        pixel_rays, pixel_at: Rays through pixels inside the image circle, and their pixels.
        coarse_rays, coarse_at: Rays of the coarse grid, and their places in it.
        between_rays, between_at, between_gap, between_corner: Rays through all other pixels inside
            the circle, their pixels, the gaps of the coarse grid they lie in (0 to the right of a
            coarse place, 1 below it, 2 both; then its row and column), and those places.
        outside_at: Pixels outside the image circle.
        coarse_shape: Rows and columns of the coarse grid; one less each of the cells.
    """

    def __init__(self, calibration: StereoCalibration) -> None:
        width, height = calibration.width, calibration.height
        self.shape, self.size = (height, width), height * width
        cells = ((height + 1) // 2, (width + 1) // 2)
        self.coarse_shape = (cells[0] + 1, cells[1] + 1)
        lattice = (2 * cells[0] + 1, 2 * cells[1] + 1)
        inside = np.zeros(lattice, dtype=np.bool_)
        inside[:height, :width] = ~calibration.outside_circle()
        rows, columns = np.nonzero(inside | _coarse_needed(inside))
        order, self.tile = order_by_tile(columns, rows, tile_px=TILE_PX)
        rows, columns = rows[order], columns[order]
        self.directions: Array = calibration.ray_directions(
            columns.astype(np.float64) + 0.5, rows.astype(np.float64) + 0.5
        )

        is_pixel, is_coarse = inside[rows, columns], (rows % 2 == 0) & (columns % 2 == 0)
        pixel = rows * width + columns
        kind = np.where(rows % 2 == 0, 0, np.where(columns % 2 == 0, 1, 2))
        gap = (kind * cells[0] + rows // 2) * cells[1] + columns // 2
        self.pixel_rays: Indices = np.flatnonzero(is_pixel)
        self.pixel_at: Indices = pixel[is_pixel]
        self.coarse_rays: Indices = np.flatnonzero(is_coarse)
        self.coarse_at: Indices = ((rows // 2) * self.coarse_shape[1] + columns // 2)[is_coarse]
        between = is_pixel & ~is_coarse
        self.between_rays: Indices = np.flatnonzero(between)
        self.between_at: Indices = pixel[between]
        self.between_gap: Indices = gap[between]
        corner = (rows // 2) * self.coarse_shape[1] + columns // 2
        self.between_corner: Indices = corner[between]
        self.outside_at: Indices = np.flatnonzero(calibration.outside_circle())

        u, v = calibration.center_px
        pair = calibration.ray_directions(np.array([u, u + 1.0]), np.array([v, v]))
        self.center_angle_rad = float(np.arctan2(pair[1, 0], pair[1, 2]))

    def on_coarse(self, values: npt.NDArray[Number]) -> npt.NDArray[Number]:
        """Lay out the values of `coarse_rays` of both eyes (2 k,) as (2, rows, columns).

        Places that no pixel needs hold 0.
        """
        grid = np.zeros((2, self.coarse_shape[0] * self.coarse_shape[1]), dtype=values.dtype)
        grid[:, self.coarse_at] = values.reshape(2, -1)
        return grid.reshape(2, *self.coarse_shape)

    def gaps_where(self, mask: npt.NDArray[np.bool_]) -> tuple[Indices, Indices]:
        """Find the pixels between whose gap is marked.

        Args:
            mask: (2, 3, rows - 1, columns - 1) marked gaps of both eyes.

        Returns:
            Eye of each, and its place in the `between` tables: ordered like the rays.
        """
        marked = np.flatnonzero(mask.reshape(2, -1).take(self.between_gap, axis=1))
        eye = (marked >= len(self.between_gap)).astype(np.intp)
        return eye, marked - eye * len(self.between_gap)


def _coarse_needed(inside: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Coarse places that are a corner of a cell with at least one pixel inside the circle."""
    used = inside[:-1:2, :-1:2] | inside[1::2, :-1:2] | inside[:-1:2, 1::2] | inside[1::2, 1::2]
    corner = np.zeros((used.shape[0] + 1, used.shape[1] + 1), dtype=np.bool_)
    for rows in (slice(None, -1), slice(1, None)):
        for columns in (slice(None, -1), slice(1, None)):
            corner[rows, columns] |= used
    needed = np.zeros_like(inside)
    needed[::2, ::2] = corner
    return needed
