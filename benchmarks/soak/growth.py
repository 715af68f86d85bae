"""Whether something that is sampled once a second grows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

from scipy.stats import theilslopes

BIN_S = 10.0
WARM_UP_SHARE = 0.25
LONGEST_WARM_UP_S = 600.0
FEWEST_BINS = 6
CONFIDENCE = 0.95


@dataclass(frozen=True)
class Growth:
    """How a quantity changes after the warm-up.

    Args:
        first: Median of the first bin.
        last: Median of the last bin.
        per_hour: Slope.
        low: Lower end of its confidence interval.
        high: Upper end.
        limit: Largest slope that is no growth.
        least: Smallest change that counts as growth.
    """

    first: float
    last: float
    per_hour: float
    low: float
    high: float
    limit: float
    least: float

    @property
    def is_growing(self) -> bool:
        """More than is allowed, for certain, and more than one step of an allocator."""
        is_steep = self.per_hour > self.limit and self.low > 0.0
        return is_steep and self.last - self.first > self.least

    @property
    def is_certain(self) -> bool:
        """Whether the interval excludes a growth beyond the limit, or proves one."""
        return self.is_growing or self.high <= self.limit


def measure_growth(
    times_s: Sequence[float], values: Sequence[float], *, limit_per_hour: float, least: float
) -> Growth | None:
    """Theil-Sen slope of the medians of ten seconds, after the warm-up.

    The warm-up is a quarter of the time, at most ten minutes: caches fill, allocators settle. The
    slope is the median of those between any two medians; a peak or a step of a short time does
    not move it.

    Args:
        times_s: When the samples were taken, rising [s].
        values: The samples.
        limit_per_hour: Largest slope that is no growth.
        least: Smallest change that counts as growth: a short run cannot tell a step from a slope.

    Returns:
        The growth, or None for fewer than six medians.
    """
    if not times_s:
        return None
    warm_up_s = min(LONGEST_WARM_UP_S, WARM_UP_SHARE * (times_s[-1] - times_s[0]))
    bins: dict[int, list[float]] = {}
    for time_s, value in zip(times_s, values, strict=True):
        if time_s - times_s[0] >= warm_up_s:
            bins.setdefault(math.floor(time_s / BIN_S), []).append(value)
    if len(bins) < FEWEST_BINS:
        return None
    hours = [number * BIN_S / 3600.0 for number in bins]
    medians = [median(each) for each in bins.values()]
    line: Any = theilslopes(medians, hours, CONFIDENCE)
    return Growth(
        first=medians[0],
        last=medians[-1],
        per_hour=float(line.slope),
        low=float(line.low_slope),
        high=float(line.high_slope),
        limit=limit_per_hour,
        least=least,
    )
