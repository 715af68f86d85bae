"""Where a ray meets the triangles of one shell, in the frame of the shell."""

from __future__ import annotations

from typing import TypeAlias

from common.se3 import Array
from services.sim.camera.compiled import device, inlined
from services.sim.camera.meshes.hull import COUNT, DEPTH, FIRST_BOX, FIRST_TRIANGLE
from services.sim.camera.primitives import INFINITE, Vector, dot
from services.sim.camera.shapes import Integers

Meeting: TypeAlias = tuple[int, float, float, float]
"""Triangle or -1, distance, and the weights of the triangle's second and third corner there."""

DEEPEST = 64
"""Nodes that wait while a ray walks down: one per level."""

_SLACK = 1e-9
"""Of the weights: neighbouring triangles overlap by so little, and no ray slips between them."""

_PARALLEL = 1e-30
"""Least determinant, and least component of a direction."""


@device
def walk(
    corners: Array,
    boxes: Array,
    parts: Integers,
    part: int,
    o: Vector,
    d: Vector,
    limit: float,
    any_will_do: bool,
    waiting: Integers,
    entries: Array,
) -> Meeting:
    """Find the first triangle that the ray o + t d meets at 0 <= t < limit.

    Args:
        corners: Of all triangles.
        boxes: Of all trees.
        parts: (s, 4), see `hull.Hull`.
        part: Which shell.
        o: Start of the ray.
        d: Its unit direction.
        limit: How far it goes.
        any_will_do: Return the triangle that is found first, near or far.
        waiting: (DEEPEST,) room.
        entries: (DEEPEST,) room.
    """
    first_box, first = parts[part, FIRST_BOX], parts[part, FIRST_TRIANGLE]
    count, depth = parts[part, COUNT], parts[part, DEPTH]
    inner = (1 << depth) - 1
    met, best, second, third = -1, limit, 0.0, 0.0
    inverse = _invert(d[0]), _invert(d[1]), _invert(d[2])
    top, waiting[0], entries[0] = 0, 0, _enter(boxes, first_box, o, inverse)
    while top >= 0:
        node, near = waiting[top], entries[top]
        top -= 1
        if near >= best:
            continue
        if node < inner:
            top = _push_children(boxes, first_box, 2 * node + 1, o, inverse, top, waiting, entries)
            continue
        leaf = node - inner
        for at in range(first + ((leaf * count) >> depth), first + (((leaf + 1) * count) >> depth)):
            t, u, v = _distance_to_triangle(corners, at, o, d)
            if t < best:
                met, best, second, third = at, t, u, v
        if any_will_do and met >= 0:
            break
    return met, best, second, third


@inlined
def _push_children(
    boxes: Array,
    first_box: int,
    child: int,
    o: Vector,
    inverse: Vector,
    top: int,
    waiting: Integers,
    entries: Array,
) -> int:
    """Let two nodes wait, the nearer one on top."""
    one = _enter(boxes, first_box + child, o, inverse)
    other = _enter(boxes, first_box + child + 1, o, inverse)
    swap = int(one < other)
    waiting[top + 1 + swap], entries[top + 1 + swap] = child, one
    waiting[top + 2 - swap], entries[top + 2 - swap] = child + 1, other
    return top + 2


@inlined
def _invert(value: float) -> float:
    """1 / value, huge instead of infinite: zero times infinity would be no number."""
    return 1.0 / value if abs(value) > _PARALLEL else 1.0 / _PARALLEL


@inlined
def _enter(boxes: Array, box: int, o: Vector, inverse: Vector) -> float:
    """First t >= 0 inside a box, or `INFINITE`."""
    x0, x1 = (boxes[box, 0, 0] - o[0]) * inverse[0], (boxes[box, 1, 0] - o[0]) * inverse[0]
    y0, y1 = (boxes[box, 0, 1] - o[1]) * inverse[1], (boxes[box, 1, 1] - o[1]) * inverse[1]
    z0, z1 = (boxes[box, 0, 2] - o[2]) * inverse[2], (boxes[box, 1, 2] - o[2]) * inverse[2]
    near = max(max(min(x0, x1), min(y0, y1)), max(min(z0, z1), 0.0))
    far = min(max(x0, x1), min(max(y0, y1), max(z0, z1)))
    return near if near <= far else INFINITE


@inlined
def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def _distance_to_triangle(corners: Array, at: int, o: Vector, d: Vector) -> Vector:
    """Solve o + t d = a + u (b - a) + v (c - a), from either side, by Cramer's rule.

    With e = b - a, f = c - a, s = o - a and D = e . (d x f):

        u = s . (d x f) / D,  v = d . (s x e) / D,  t = f . (s x e) / D

    (Moeller and Trumbore, "Fast, minimum storage ray/triangle intersection", 1997.)

    Returns:
        t, `INFINITE` where the triangle is not met; u; v.
    """
    ax, ay, az = corners[at, 0, 0], corners[at, 0, 1], corners[at, 0, 2]
    e = corners[at, 1, 0] - ax, corners[at, 1, 1] - ay, corners[at, 1, 2] - az
    f = corners[at, 2, 0] - ax, corners[at, 2, 1] - ay, corners[at, 2, 2] - az
    s = o[0] - ax, o[1] - ay, o[2] - az
    p, q = _cross(d, f), _cross(s, e)
    determinant = dot(e, p)
    if abs(determinant) < _PARALLEL:
        return INFINITE, 0.0, 0.0
    scale = 1.0 / determinant
    u, v, t = scale * dot(s, p), scale * dot(d, q), scale * dot(f, q)
    inside = (u >= -_SLACK) & (v >= -_SLACK) & (u + v <= 1.0 + _SLACK) & (t >= 0.0)
    return (t if inside else INFINITE), u, v


@inlined
def flat_normal(corners: Array, at: int) -> Vector:
    """(b - a) x (c - a): outward, as long as twice the triangle's area."""
    ax, ay, az = corners[at, 0, 0], corners[at, 0, 1], corners[at, 0, 2]
    e = corners[at, 1, 0] - ax, corners[at, 1, 1] - ay, corners[at, 1, 2] - az
    f = corners[at, 2, 0] - ax, corners[at, 2, 1] - ay, corners[at, 2, 2] - az
    return _cross(e, f)
