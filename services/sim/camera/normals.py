"""Outward unit normals of the six kinds of shape, in the shape's own frame.

o and d are start and direction of the ray, t where it meets the surface, s the shape's size.
"""

from __future__ import annotations

import math

from services.sim.camera.compiled import inlined
from services.sim.camera.primitives import (
    BOX,
    CAPSULE,
    CYLINDER,
    ELLIPSOID,
    SPHERE,
    Vector,
    span_slab,
)


@inlined
def _unit(x: float, y: float, z: float) -> Vector:
    length = math.sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length


@inlined
def _side(value: float) -> float:
    return 1.0 if value > 0.0 else -1.0


@inlined
def _meets(o: float, d: float, half: float, t: float) -> bool:
    """Whether t is where the ray crosses one of the planes x = -+half: the same bits."""
    near, far = span_slab(o, d, half)
    return (t == near) | (t == far)


@inlined
def normal_of_cylinder(o: Vector, d: Vector, half: float, t: float) -> Vector:
    """(0, 0, -+1) on the flat ends, (x, y, 0) / |(x, y)| on the round side."""
    if _meets(o[2], d[2], half, t):
        return 0.0, 0.0, _side(o[2] + t * d[2])
    return _unit(o[0] + t * d[0], o[1] + t * d[1], 0.0)


@inlined
def normal_of_box(o: Vector, d: Vector, s: Vector, t: float) -> Vector:
    """The axis of the face that is met."""
    if _meets(o[0], d[0], s[0], t):
        return _side(o[0] + t * d[0]), 0.0, 0.0
    if _meets(o[1], d[1], s[1], t):
        return 0.0, _side(o[1] + t * d[1]), 0.0
    return 0.0, 0.0, _side(o[2] + t * d[2])


@inlined
def normal_of(kind: int, o: Vector, d: Vector, s: Vector, t: float) -> Vector:
    """Normal of a shape of any kind.

    Sphere: p / |p|. Capsule: from the nearest point of its axis to p. Ellipsoid: along
    (x / s_x^2, y / s_y^2, z / s_z^2). Plane: (0, 0, 1).
    """
    x, y, z = o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2]
    if kind == BOX:
        return normal_of_box(o, d, s, t)
    if kind == CYLINDER:
        return normal_of_cylinder(o, d, s[1], t)
    if kind == CAPSULE:
        return _unit(x, y, z - min(max(z, -s[1]), s[1]))
    if kind == SPHERE:
        return _unit(x, y, z)
    if kind == ELLIPSOID:
        return _unit(x / (s[0] * s[0]), y / (s[1] * s[1]), z / (s[2] * s[2]))
    return 0.0, 0.0, 1.0
