"""Bounding pyramids of bundles of rays: neighbours that share one origin.

A picture is cut into tiles; the rays of one tile form a bundle. What lies outside a bundle's
pyramid cannot be hit by any of its rays, which is what makes tracing fast (`culling`).
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np

from common.se3 import Array
from services.sim.camera.compiled import device
from services.sim.camera.shapes import Integers

AXIS, SIDES, CORNERS, CONE, PYRAMID_ROWS = 0, 1, 5, 9, 10
"""Rows of a pyramid, an array (10, 3) in world axes: the direction of its middle, four inward
normals, the directions of its four edges, and (cos a, sin a, 0) of the half angle a of the cone
about the middle that holds all of it."""

_MARGIN = 1e-6
"""Widening of the pyramids (tangent units), far above rounding."""

_LEAST_COSINE = 0.2
"""Rays further than this from the middle of their bundle have no useful pyramid."""


class Bundles(NamedTuple):
    """Frames and extents of bundles of rays.

    Args:
        axes: (bundles, 3, 3) columns: unit vectors across, down and along, in the camera frame.
        bounds: (bundles, 4) least and greatest x/z, then y/z, of the rays in that frame; not a
            number where a bundle is too wide for a pyramid.
    """

    axes: Array
    bounds: Array


def bound_directions(directions: Array, starts: Integers) -> Bundles:
    """Bound bundles of rays.

    Args:
        directions: (n, 3) unit vectors, bundle after bundle.
        starts: (bundles + 1,) where each bundle starts, and n.
    """
    axes, bounds = np.empty((len(starts) - 1, 3, 3)), np.full((len(starts) - 1, 4), np.nan)
    for bundle, (first, end) in enumerate(itertools.pairwise(starts.tolist())):
        rays = directions[first:end]
        along = rays.sum(axis=0)
        # Rays all around have no middle: any will do, as there is no pyramid either.
        length = float(np.sqrt((along * along).sum()))
        along = along / length if length > _LEAST_COSINE else np.array([0.0, 0.0, 1.0])
        across = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
        across /= np.sqrt((across * across).sum())
        axes[bundle] = np.stack([across, np.cross(along, across), along], axis=1)
        x, y, z = (rays[:, :, None] * axes[bundle]).sum(axis=1).T
        if z.min(initial=1.0) >= _LEAST_COSINE:
            u, v = x / z, y / z
            bounds[bundle] = u.min(), u.max(), v.min(), v.max()
    bounds += np.array([-_MARGIN, _MARGIN, -_MARGIN, _MARGIN])
    return Bundles(axes, bounds)


@device
def raise_pyramid(
    R: Array,
    frame: int,
    left: float,
    right: float,
    top: float,
    bottom: float,
    pyramids: Array,
    at: int,
) -> None:
    """Fill one of the pyramids from its frame and the rectangle it cuts out of the plane z = 1.

    Its sides have the inward normals (1, 0, -left), (-1, 0, right), (0, 1, -top), (0, -1, bottom).
    Bounds that are no numbers give a pyramid that holds everything.

    Args:
        R: (n, 3, 3) columns: axes across, down and along of frames, in the world.
        frame: Which frame.
        left: Least x/z.
        right: Greatest x/z.
        top: Least y/z.
        bottom: Greatest y/z.
        pyramids: (n, 10, 3) number `at` is filled.
        at: Which one.
    """
    for row in range(PYRAMID_ROWS):
        pyramids[at, row, 0] = pyramids[at, row, 1] = pyramids[at, row, 2] = 0.0
    pyramids[at, CONE, 0] = -1.0
    if math.isnan(left):
        return
    row = AXIS
    row = _put(R, frame, 0.5 * (left + right), 0.5 * (top + bottom), 1.0, pyramids, at, row)
    row = _put(R, frame, 1.0, 0.0, -left, pyramids, at, row)
    row = _put(R, frame, -1.0, 0.0, right, pyramids, at, row)
    row = _put(R, frame, 0.0, 1.0, -top, pyramids, at, row)
    row = _put(R, frame, 0.0, -1.0, bottom, pyramids, at, row)
    for y in (top, bottom):
        row = _put(R, frame, left, y, 1.0, pyramids, at, row)
        row = _put(R, frame, right, y, 1.0, pyramids, at, row)
    cosine = 1.0
    for edge in range(CORNERS, CORNERS + 4):
        dot = 0.0
        for k in range(3):
            dot += pyramids[at, AXIS, k] * pyramids[at, edge, k]
        cosine = min(cosine, dot)
    pyramids[at, CONE, 0] = cosine
    pyramids[at, CONE, 1] = math.sqrt(max(0.0, 1.0 - cosine * cosine))


@device
def _put(
    R: Array, frame: int, x: float, y: float, z: float, pyramids: Array, at: int, row: int
) -> int:
    """Row = R[frame] (x, y, z) / |(x, y, z)|; returns the next row."""
    scale = 1.0 / math.sqrt(x * x + y * y + z * z)
    for k in range(3):
        pyramids[at, row, k] = scale * (
            R[frame, k, 0] * x + R[frame, k, 1] * y + R[frame, k, 2] * z
        )
    return row + 1


@device
def turn_axes(R_a_b: Array, R_b_c: Array, at: int, R_a_c: Array) -> None:
    """R_a_c[0] = R_a_b R_b_c[at]; R_a_b is (3, 3), the others are (n, 3, 3)."""
    for i in range(3):
        for j in range(3):
            R_a_c[0, i, j] = (
                R_a_b[i, 0] * R_b_c[at, 0, j]
                + R_a_b[i, 1] * R_b_c[at, 1, j]
                + R_a_b[i, 2] * R_b_c[at, 2, j]
            )
