"""Patterns on surfaces: which geom has which, and how bright each point of it is.

A pattern is a wave between two tones, 1 and `dark`. It fades to the mean of both where its parts
span less than four rays, and is gone at two: finer parts than the picture can show would only make
moire. Patterns lie in the geom's own frame, so that they move with it and show how it is turned;
only the checker lies in the world.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from services.sim.camera.compiled import inlined
from services.sim.camera.primitives import Vector

PLAIN, TOP_CHECKER, STRIPES, SPECKLE, RINGS = range(5)
"""Kinds, see `wave_of`; the checker is only on horizontal top faces."""

_CELL_SHIFT = 0.318
"""Faces lie at round fractions of a period; cells of the speckle begin elsewhere."""


@dataclass(frozen=True)
class Pattern:
    """A pattern of the geoms whose name starts with `prefix`.

    Args:
        prefix: Start of the geom's name.
        kind: One of the kinds above.
        period_m: Size of its parts.
        dark: Albedo of the dark parts over that of the light ones.
    """

    prefix: str
    kind: int
    period_m: float
    dark: float


PATTERNS = (
    Pattern("floor", TOP_CHECKER, 0.25, 0.75),
    Pattern("table", TOP_CHECKER, 0.10, 0.85),
    Pattern("cabinet", STRIPES, 0.06, 0.8),
    Pattern("door", STRIPES, 0.06, 0.8),
    Pattern("case", STRIPES, 0.04, 0.8),
    Pattern("stove", SPECKLE, 0.04, 0.6),
    Pattern("pot", SPECKLE, 0.04, 0.7),
    Pattern("lid_disc", RINGS, 0.04, 0.8),
)

_NONE = Pattern("", PLAIN, 1.0, 1.0)


def find_pattern(name: str) -> Pattern:
    """The pattern of a geom with this name: the first in the table that fits."""
    return next((pattern for pattern in PATTERNS if name.startswith(pattern.prefix)), _NONE)


@inlined
def wave_of(kind: int, world: Vector, local: Vector, period: float, salt: int) -> float:
    """Between 1 on light parts and -1 on dark ones.

    Checker: squares of the world's x-y plane. Stripes: layers of x + y + z, which cross every face
    aslant. Speckle: a random tone for each cube of the geom's frame. Rings: about the geom's z.

    Args:
        kind: Of the pattern.
        world: (x, y, z) in the world [m].
        local: (x, y, z) in the geom's frame [m].
        period: Size of the parts [m].
        salt: Tells the speckles of different geoms apart.
    """
    if kind == TOP_CHECKER:
        return _sign(math.floor(world[0] / period) + math.floor(world[1] / period))
    x, y, z = local[0] / period, local[1] / period, local[2] / period
    if kind == STRIPES:
        return _sign(math.floor(x + y + z))
    if kind == RINGS:
        return _sign(math.floor(math.sqrt(x * x + y * y)))
    return speckle(
        math.floor(x + _CELL_SHIFT), math.floor(y + _CELL_SHIFT), math.floor(z + _CELL_SHIFT), salt
    )


@inlined
def _sign(number: float) -> float:
    """1 for even numbers, -1 for odd ones."""
    half = 0.5 * number
    return 1.0 - 4.0 * (half - math.floor(half))


@inlined
def speckle(x: float, y: float, z: float, salt: int) -> float:
    """A number from -1 to 1 that depends on whole x, y, z and salt only: their integer hash."""
    mixed = (int(x) * 73856093) ^ (int(y) * 19349663) ^ (int(z) * 83492791) ^ (salt * 2654435)
    for _ in range(2):
        # 24 bits times 31 bits: never more than an int64 holds.
        mixed = (mixed & 0xFFFFFF) * 1274126177
        mixed ^= mixed >> 23
    return (mixed & 0xFFFF) / 32767.5 - 1.0


@inlined
def tone_of(wave: float, dark: float, rays_per_period: float) -> float:
    """(1 + dark) / 2 + wave sharpness (1 - dark) / 2; sharpness 1 from 4 rays a period, 0 to 2."""
    sharpness = min(max(2.0 - 4.0 / rays_per_period, 0.0), 1.0)
    return 0.5 * (1.0 + dark) + 0.5 * (1.0 - dark) * sharpness * wave
