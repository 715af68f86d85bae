"""Random postures of a robot."""

from __future__ import annotations

import numpy as np

from common.se3 import Array


def draw_posture(lower: Array, upper: Array, random: np.random.Generator) -> Array:
    """Joint positions (n,) anywhere in their ranges; half a turn either way where there is none."""
    return random.uniform(
        np.where(np.isfinite(lower), lower, -np.pi), np.where(np.isfinite(upper), upper, np.pi)
    )
