"""The little statistics that results are reported with."""

from __future__ import annotations

import math
from collections.abc import Sequence

_Z95 = 1.959963984540054


def wilson_interval95(successes: int, trials: int) -> tuple[float, float]:
    """Wilson score interval of a success rate at 95 %.

    centre = (p + z²/2n) / (1 + z²/n), half = z sqrt(p(1-p)/n + z²/4n²) / (1 + z²/n).

    Args:
        successes: Number of successes.
        trials: Number of trials; 0 gives the interval (0, 1): nothing is known.

    Source: E. B. Wilson, JASA 22 (1927).
    """
    if trials == 0:
        return 0.0, 1.0
    p = successes / trials
    z2n = _Z95 * _Z95 / trials
    centre = (p + 0.5 * z2n) / (1.0 + z2n)
    half = _Z95 * math.sqrt(p * (1.0 - p) / trials + 0.25 * z2n / trials) / (1.0 + z2n)
    return max(0.0, centre - half), min(1.0, centre + half)


def median(values: Sequence[float]) -> float | None:
    """Middle value, mean of the middle two for an even count, None for no values."""
    return quantile(values, 0.5)


def quantile(values: Sequence[float], q: float) -> float | None:
    """Linear interpolation between order statistics (type 7), None for no values."""
    if not values:
        return None
    ordered = sorted(values)
    position = q * (len(ordered) - 1)
    below = math.floor(position)
    above = min(below + 1, len(ordered) - 1)
    return ordered[below] + (position - below) * (ordered[above] - ordered[below])
