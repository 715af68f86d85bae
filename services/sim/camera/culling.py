"""Which shapes can the rays of a bundle meet at all?

A shape is left out if its bounding sphere lies outside the cone around the bundle, or all of it on
the outer side of one of the four sides of the bundle's pyramid. The answers err on the safe side,
so they change what tracing costs and never what it finds.
"""

from __future__ import annotations

import math
from typing import Any

from common.se3 import Array
from services.sim.camera.compiled import device, inlined
from services.sim.camera.primitives import BOX, CAPSULE, CYLINDER, ELLIPSOID, INFINITE, PLANE
from services.sim.camera.pyramids import AXIS, CONE, CORNERS, SIDES
from services.sim.camera.shapes import Index, Integers, Table, to_shape

_MARGIN = 1e-9
"""Far above rounding, in radians and metres."""


@device
def find_candidates(
    pyramids: Array,
    at: int,
    shapes: Table,
    views: Table,
    view: Index,
    candidates: Integers,
    row: int,
) -> None:
    """List the shapes that may be met inside a pyramid that stands on the view's origin.

    Args:
        pyramids: (n, 10, 3), see `pyramids`.
        at: Which of the pyramids.
        shapes: (g,) where they are.
        views: (VIEWS, g).
        view: The one from the apex.
        candidates: (n, 1 + g) one row is filled: how many, then which, the nearest first.
        row: Which row.
    """
    count = 0
    for place in range(len(shapes)):
        number = views[view, place].order
        shape, sight = shapes[number], views[view, number]
        if _in_cone(sight, pyramids, at) and _in_pyramid(shape, sight, pyramids, at):
            count += 1
            candidates[row, count] = number
    candidates[row, 0] = count


@inlined
def _in_cone(sight: Any, pyramids: Array, at: int) -> bool:
    """Angle between middle of the cone and of the sphere <= sum of both half angles."""
    cosine, sine = pyramids[at, CONE, 0], pyramids[at, CONE, 1]
    if cosine * sight.sine + sine * sight.cosine <= _MARGIN:  # together half a turn or more
        return True
    along = (
        pyramids[at, AXIS, 0] * sight.cx
        + pyramids[at, AXIS, 1] * sight.cy
        + pyramids[at, AXIS, 2] * sight.cz
    )
    return along >= sight.distance * (cosine * sight.cosine - sine * sight.sine - _MARGIN)


@inlined
def _in_pyramid(shape: Any, sight: Any, pyramids: Array, at: int) -> bool:
    """N . c + reach(n) >= 0 for all four sides n."""
    if shape.kind == PLANE and not _looks_down(shape, sight, pyramids, at):
        return False
    for side in range(SIDES, SIDES + 4):
        nx, ny, nz = pyramids[at, side, 0], pyramids[at, side, 1], pyramids[at, side, 2]
        depth = nx * sight.cx + ny * sight.cy + nz * sight.cz
        if depth + _reach(shape, nx, ny, nz) < -_MARGIN:
            return False
    return True


@inlined
def _reach(shape: Any, nx: float, ny: float, nz: float) -> float:
    """How far a shape reaches from its origin along the unit vector n of the world."""
    x, y, z = to_shape(shape, nx, ny, nz)
    if shape.kind == BOX:
        return shape.sx * abs(x) + shape.sy * abs(y) + shape.sz * abs(z)
    if shape.kind == CYLINDER:
        return shape.sx * math.sqrt(x * x + y * y) + shape.sy * abs(z)
    if shape.kind == CAPSULE:
        return shape.sx + shape.sy * abs(z)
    if shape.kind == ELLIPSOID:
        return math.sqrt((shape.sx * x) ** 2 + (shape.sy * y) ** 2 + (shape.sz * z) ** 2)
    if shape.kind == PLANE:
        along = shape.sx * abs(x) if shape.sx > 0.0 else INFINITE
        across = shape.sy * abs(y) if shape.sy > 0.0 else INFINITE
        return along + across
    return shape.sx


@inlined
def _looks_down(shape: Any, sight: Any, pyramids: Array, at: int) -> bool:
    """Whether the apex is in front of a plane and an edge of the pyramid leads towards it."""
    if sight.oz < -_MARGIN:
        return False
    if pyramids[at, CONE, 0] == -1.0:
        return True
    least = 1.0
    for edge in range(CORNERS, CORNERS + 4):
        slope = (
            shape.r02 * pyramids[at, edge, 0]
            + shape.r12 * pyramids[at, edge, 1]
            + shape.r22 * pyramids[at, edge, 2]
        )
        least = min(least, slope)
    return least < _MARGIN
