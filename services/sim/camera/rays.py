"""Bundles of rays against shapes: the innermost loops of the camera.

A bundle is up to m rays from one point. `rays` (BUNDLES, ROWS, m) holds the numbers of all bundles,
`marks` (BUNDLES, MARKS, m) the integers; a row for each quantity, so that loops over rays become
vector instructions.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from common.se3 import Array
from services.sim.camera.compiled import device, inlined, stage
from services.sim.camera.primitives import (
    BOX,
    CAPSULE,
    CYLINDER,
    PLANE,
    SPHERE,
    distance_to_box,
    distance_to_capsule,
    distance_to_cylinder,
    distance_to_ellipsoid,
    distance_to_plane,
    distance_to_sphere,
)
from services.sim.camera.shapes import Index, Integers, Table, to_shape

WAITING, BUNDLES = 2, 3
"""Bundles, after those of the two views: pixels that only wait for the tone of their pattern."""

X, Y, Z, DISTANCE, FACTOR, LIT, TONE, BASE, TO_X, TO_Y, TO_Z, RANGE, ROWS = range(13)
"""Rows of `rays`: unit direction in the world; distance to what is met, and before tracing how far
the ray goes [m]; then of the hit: light factor, light of the point light n . l, tone of the
pattern, intensity without pattern, vector from the light to it and the length of that [m]."""

SHAPE_MET, SURFACE, ROW, COLUMN, POINT, CELL, MARKS = range(7)
"""Rows of `marks`: number of the shape that is met, -1 if none; surface that is met; row and column
of the ray on the lens; point that a ray from the light leads to; cell of the light's grid."""


def make_rays(most: int) -> Array:
    """Room for the numbers of bundles of at most this many rays."""
    return np.zeros((BUNDLES, ROWS, most))


def make_marks(most: int) -> Integers:
    """Room for the integers of bundles of at most this many rays."""
    return np.zeros((BUNDLES, MARKS, most), dtype=np.int64)


@device
def trace(
    rays: Array,
    marks: Integers,
    view: Index,
    count: int,
    shapes: Table,
    views: Table,
    candidates: Integers,
    at: int,
) -> None:
    """Find what the first `count` rays of a bundle meet first: `DISTANCE` and `SHAPE_MET`.

    Hits at exactly the same distance go to the lower shape, whatever the order of the candidates.

    Args:
        rays: Directions and how far the rays go.
        marks: `SHAPE_MET` is filled.
        view: From where the rays start: of the bundles and of the views.
        count: How many of its rays.
        shapes: (g,) where they are.
        views: (VIEWS, g).
        candidates: (n, 1 + g) row `at`: how many shapes may be met, and which, the nearest first.
        at: Which row.
    """
    for k in range(count):
        marks[view, SHAPE_MET, k] = -1
    for place in range(1, 1 + candidates[at, 0]):
        met = candidates[at, place]
        longest = 0.0
        for k in range(count):
            longest = max(longest, rays[view, DISTANCE, k])
        if views[view, met].nearest > longest:
            return
        _meet(rays, marks, view, count, met, shapes[met], views[view, met])


@stage
def _meet(
    rays: Array,
    marks: Integers,
    view: Index,
    count: int,
    met: int,
    shape: Any,
    sight: Any,
) -> None:
    """Turn `count` rays into the frame of one shape, and keep the hits that come first."""
    o, s = (sight.ox, sight.oy, sight.oz), (shape.sx, shape.sy, shape.sz)
    kind = shape.kind
    if kind == BOX:
        for k in range(count):
            d = _local(rays, view, k, shape)
            _keep(rays, marks, view, k, met, distance_to_box(o, d, s))
    elif kind == CYLINDER:
        for k in range(count):
            d = _local(rays, view, k, shape)
            _keep(rays, marks, view, k, met, distance_to_cylinder(o, d, s))
    elif kind == CAPSULE:
        for k in range(count):
            d = _local(rays, view, k, shape)
            _keep(rays, marks, view, k, met, distance_to_capsule(o, d, s))
    elif kind == PLANE:
        for k in range(count):
            d = _local(rays, view, k, shape)
            _keep(rays, marks, view, k, met, distance_to_plane(o, d, s))
    elif kind == SPHERE:
        for k in range(count):
            d = _local(rays, view, k, shape)
            _keep(rays, marks, view, k, met, distance_to_sphere(o, d, s))
    else:
        for k in range(count):
            d = _local(rays, view, k, shape)
            _keep(rays, marks, view, k, met, distance_to_ellipsoid(o, d, s))


@inlined
def _local(rays: Array, view: Index, k: int, shape: Any) -> tuple[float, float, float]:
    return to_shape(shape, rays[view, X, k], rays[view, Y, k], rays[view, Z, k])


@inlined
def _keep(rays: Array, marks: Integers, view: Index, k: int, met: int, distance: float) -> None:
    best, before = rays[view, DISTANCE, k], marks[view, SHAPE_MET, k]
    nearer = (distance < best) | ((distance == best) & (met < before))
    rays[view, DISTANCE, k] = distance if nearer else best
    marks[view, SHAPE_MET, k] = met if nearer else before


@inlined
def distance_along(x: float, y: float, z: float, shape: Any, sight: Any) -> float:
    """Distance to one shape along one ray with the unit direction (x, y, z)."""
    d, o, s = (
        to_shape(shape, x, y, z),
        (sight.ox, sight.oy, sight.oz),
        (shape.sx, shape.sy, shape.sz),
    )
    if shape.kind == BOX:
        return distance_to_box(o, d, s)
    if shape.kind == CYLINDER:
        return distance_to_cylinder(o, d, s)
    if shape.kind == CAPSULE:
        return distance_to_capsule(o, d, s)
    if shape.kind == PLANE:
        return distance_to_plane(o, d, s)
    if shape.kind == SPHERE:
        return distance_to_sphere(o, d, s)
    return distance_to_ellipsoid(o, d, s)
