"""All shapes as seen from one point: an eye or the light."""

from __future__ import annotations

import math

import numpy as np

from services.sim.camera.compiled import device
from services.sim.camera.primitives import PLANE
from services.sim.camera.shapes import Index, Table, to_shape

SIGHT = np.dtype(
    [
        *((name, np.float64) for name in ("cx", "cy", "cz", "ox", "oy", "oz")),
        *((name, np.float64) for name in ("distance", "cosine", "sine", "nearest")),
        ("order", np.int64),
    ]
)
"""How one shape lies to a point: c from the point to the shape's origin, world axes [m]; the point
o in the shape's own frame [m]; the distance |c|; cosine and sine of the angle at which its bounding
sphere is seen, (-1, 0) from inside; no part of the shape is nearer than `nearest` [m]. `order` is
not of this shape: it is the number of the shape that comes in this place, the nearest first."""


EYE, LIGHT, VIEWS = np.int64(0), np.int64(1), 2
"""Rows of a table of views (VIEWS, g): from the eye in turn, and from the light; and the bundles of
rays from there. Numba compiles a function anew for each plain number that it is called with, but
once for all of these."""


@device
def look_from(x: float, y: float, z: float, shapes: Table, views: Table, view: Index) -> None:
    """Fill one view of g shapes from the point (x, y, z)."""
    for number in range(len(shapes)):
        shape, sight = shapes[number], views[view, number]
        sight.cx, sight.cy, sight.cz = shape.px - x, shape.py - y, shape.pz - z
        sight.ox, sight.oy, sight.oz = to_shape(shape, -sight.cx, -sight.cy, -sight.cz)
        distance = math.sqrt(sight.cx**2 + sight.cy**2 + sight.cz**2)
        sight.distance, sight.cosine, sight.sine = distance, -1.0, 0.0
        if shape.radius < distance:
            sight.sine = shape.radius / distance
            sight.cosine = math.sqrt(1.0 - sight.sine * sight.sine)
        sight.nearest = max(0.0, distance - shape.radius)
        if shape.kind == PLANE:
            sight.nearest = abs(sight.oz)
    _sort(views, view)


@device
def _sort(views: Table, view: Index) -> None:
    """Insertion sort; the lower number first where two are equally near."""
    for number in range(views.shape[1]):
        at, nearest = number, views[view, number].nearest
        while at > 0 and views[view, views[view, at - 1].order].nearest > nearest:
            views[view, at].order = views[view, at - 1].order
            at -= 1
        views[view, at].order = number
