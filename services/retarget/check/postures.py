"""Random postures of a robot."""

from __future__ import annotations

import numpy as np

from common.se3 import Array


def bound_ranges(lower: Array, upper: Array) -> tuple[Array, Array]:
    """Limits (n,), with half a turn either way where there are none."""
    return (
        np.where(np.isfinite(lower), lower, -np.pi),
        np.where(np.isfinite(upper), upper, np.pi),
    )


def draw_posture(lower: Array, upper: Array, random: np.random.Generator) -> Array:
    """Joint positions (n,) anywhere in their ranges."""
    return random.uniform(*bound_ranges(lower, upper))
