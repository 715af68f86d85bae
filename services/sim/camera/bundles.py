"""Rays in bundles: neighbours that share one origin and one bounding pyramid.

A picture is cut into tiles; the rays of one tile form a bundle. What lies outside a bundle's
pyramid cannot be hit by any of its rays, which is what makes tracing fast (`culling`).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from common.se3 import Array

Indices: TypeAlias = npt.NDArray[np.intp]

_MARGIN = 1e-6
"""Widening of the bounding pyramids (tangent units), far above rounding."""


@dataclass(frozen=True)
class Tangents:
    """Bounding pyramids seen from their apex: a frame and a rectangle in its tangent plane.

    Args:
        axes: (bundles, 3, 3) rows: unit vectors across, down and along.
        bounds: (bundles, 4) least and greatest x/z and y/z of the rays in that frame.
    """

    axes: Array
    bounds: Array

    def normals(self) -> Array:
        """(bundles, 4, 3) inward normals of the four sides."""
        x, y, z = self.axes[:, 0], self.axes[:, 1], self.axes[:, 2]
        left, right, top, bottom = (self.bounds[:, k, None] for k in range(4))
        return np.stack([x - left * z, right * z - x, y - top * z, bottom * z - y], axis=1)

    def corners(self) -> Array:
        """(bundles, 4, 3) directions of the four edges."""
        x, y, z = self.axes[:, 0], self.axes[:, 1], self.axes[:, 2]
        left, right, top, bottom = (self.bounds[:, k, None] for k in range(4))
        return np.stack(
            [u * x + v * y + z for u in (left, right) for v in (top, bottom)],
            axis=1,
        )


def bound_directions(directions: Array, starts: Indices) -> Tangents:
    """Bounding pyramids of bundles of rays; each bundle must fit in a cone of less than 90 deg.

    Args:
        directions: (n, 3) unit vectors, bundle after bundle.
        starts: (bundles + 1,) where each bundle starts, and n.
    """
    axes, bounds = np.empty((len(starts) - 1, 3, 3)), np.empty((len(starts) - 1, 4))
    for bundle, (first, end) in enumerate(itertools.pairwise(starts.tolist())):
        rays = directions[first:end]
        along = rays.mean(axis=0)
        along /= np.linalg.norm(along)
        across = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
        across /= np.linalg.norm(across)
        axes[bundle] = across, np.cross(along, across), along
        x, y, z = (rays @ axes[bundle].T).T
        u, v = x / z, y / z
        bounds[bundle] = u.min(), u.max(), v.min(), v.max()
    bounds += np.array([-_MARGIN, _MARGIN, -_MARGIN, _MARGIN])
    return Tangents(axes, bounds)


def order_by_tile(columns: Indices, rows: Indices, *, tile_px: int) -> tuple[Indices, Indices]:
    """Order pixels tile after tile.

    Args:
        columns: (n,) pixel columns.
        rows: (n,) pixel rows.
        tile_px: Edge of a tile.

    Returns:
        (n,) order and (n,) tile number of the ordered pixels, counted from 0 without gaps.
    """
    key = (rows // tile_px) * (1 + int(columns.max()) // tile_px) + columns // tile_px
    order = np.argsort(key, kind="stable")
    return order, np.unique(key[order], return_inverse=True)[1]
