"""Where rays meet the six kinds of shape, each in the shape's own frame.

All shapes but the plane are convex solids: a ray o + t d is inside for t from `near` to `far`, and
meets the surface first at near, or at far if it starts inside. A plane has one visible side. Rays
have unit length; `INFINITE` stands for no hit. The functions have no early exits, so that a loop
over rays can become vector instructions.

Each function documents its formula with o the ray's start, d its direction, both in the frame of
the shape, and s the shape's size as MuJoCo gives it.
"""

from __future__ import annotations

import math
from typing import TypeAlias

from services.sim.camera.compiled import inlined

Vector: TypeAlias = tuple[float, float, float]

INFINITE = 1e30

PLANE, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX = 0, 2, 3, 4, 5, 6
"""Kinds of shape, as in `mujoco.mjtGeom`."""

_TINY = 1e-15
"""MuJoCo's least discriminant and least slope: below, a ray grazes or runs parallel."""


@inlined
def dot(a: Vector, b: Vector) -> float:
    """Scalar product of a and b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def first_ahead(near: float, far: float) -> float:
    """First t >= 0 on the surface of a convex solid that the ray is inside of from near to far."""
    ahead = near if near >= 0.0 else far
    return ahead if (near <= far) & (ahead >= 0.0) else INFINITE


@inlined
def span_quadric(a: float, b: float, c: float) -> tuple[float, float]:
    """Where a t^2 + 2 b t + c <= 0: (-b -+ sqrt(b^2 - a c)) / a; near > far if nowhere."""
    square = b * b - a * c
    crosses = square >= _TINY
    root = math.sqrt(square if crosses else 1.0)
    inverse = 1.0 / (a if crosses else 1.0)
    near, far = (-b - root) * inverse, (-b + root) * inverse
    return (near if crosses else INFINITE), (far if crosses else -INFINITE)


@inlined
def span_slab(o: float, d: float, half: float) -> tuple[float, float]:
    """Where |o + t d| <= half: from (-half - o) / d to (half - o) / d; near > far if nowhere."""
    parallel = abs(d) <= _TINY
    inverse = 1.0 / (1.0 if parallel else d)
    one, other = (-half - o) * inverse, (half - o) * inverse
    near, far = min(one, other), max(one, other)
    always = -INFINITE if abs(o) <= half else INFINITE
    return (always if parallel else near), (-always if parallel else far)


@inlined
def span_round(o: Vector, d: Vector, radius: float) -> tuple[float, float]:
    """Where (o_x + t d_x)^2 + (o_y + t d_y)^2 <= radius^2; parallel rays inside: everywhere."""
    c = o[0] * o[0] + o[1] * o[1] - radius * radius
    a, b = d[0] * d[0] + d[1] * d[1], o[0] * d[0] + o[1] * d[1]
    near, far = span_quadric(a, b, c)
    along = (b * b - a * c < _TINY) & (c <= 0.0)
    return (-INFINITE if along else near), (INFINITE if along else far)


@inlined
def distance_to_plane(o: Vector, d: Vector, s: Vector) -> float:
    """T = -o_z / d_z from the front (d_z < 0), within |x| <= s_x, |y| <= s_y (0: endless)."""
    faces = d[2] <= -_TINY
    t = -o[2] / (d[2] if faces else 1.0)
    x, y = abs(o[0] + t * d[0]), abs(o[1] + t * d[1])
    inside = ((s[0] <= 0.0) | (x <= s[0])) & ((s[1] <= 0.0) | (y <= s[1]))
    return t if faces & (t >= 0.0) & inside else INFINITE


@inlined
def distance_to_sphere(o: Vector, d: Vector, s: Vector) -> float:
    """|o + t d|^2 = s_x^2."""
    near, far = span_quadric(dot(d, d), dot(o, d), dot(o, o) - s[0] * s[0])
    return first_ahead(near, far)


@inlined
def distance_to_ellipsoid(o: Vector, d: Vector, s: Vector) -> float:
    """sum_k (o_k + t d_k)^2 / s_k^2 = 1."""
    w = 1.0 / (s[0] * s[0]), 1.0 / (s[1] * s[1]), 1.0 / (s[2] * s[2])
    wd = w[0] * d[0], w[1] * d[1], w[2] * d[2]
    wo = w[0] * o[0], w[1] * o[1], w[2] * o[2]
    near, far = span_quadric(dot(wd, d), dot(wo, d), dot(wo, o) - 1.0)
    return first_ahead(near, far)


@inlined
def distance_to_cylinder(o: Vector, d: Vector, s: Vector) -> float:
    """Round side and flat ends: x^2 + y^2 <= s_x^2 and |z| <= s_y."""
    near_side, far_side = span_round(o, d, s[0])
    near_end, far_end = span_slab(o[2], d[2], s[1])
    return first_ahead(max(near_side, near_end), min(far_side, far_end))


@inlined
def distance_to_capsule(o: Vector, d: Vector, s: Vector) -> float:
    """A cylinder and two balls of radius s_x about (0, 0, -+s_y); together they are convex."""
    near_side, far_side = span_round(o, d, s[0])
    near_end, far_end = span_slab(o[2], d[2], s[1])
    near, far = max(near_side, near_end), min(far_side, far_end)
    in_tube = near <= far
    b, c = o[0] * d[0] + o[1] * d[1], o[0] * o[0] + o[1] * o[1] - s[0] * s[0]
    a, up, down = dot(d, d), o[2] - s[1], o[2] + s[1]
    near_up, far_up = span_quadric(a, b + up * d[2], c + up * up)
    near_down, far_down = span_quadric(a, b + down * d[2], c + down * down)
    near = min(near if in_tube else INFINITE, min(near_up, near_down))
    far = max(far if in_tube else -INFINITE, max(far_up, far_down))
    return first_ahead(near, far)


@inlined
def distance_to_box(o: Vector, d: Vector, s: Vector) -> float:
    """|x| <= s_x, |y| <= s_y and |z| <= s_z."""
    near_x, far_x = span_slab(o[0], d[0], s[0])
    near_y, far_y = span_slab(o[1], d[1], s[1])
    near_z, far_z = span_slab(o[2], d[2], s[2])
    return first_ahead(max(near_x, max(near_y, near_z)), min(far_x, min(far_y, far_z)))
