"""The learning rate over a run."""

from __future__ import annotations

import math


def learning_rate(update: int, *, peak: float, warmup: int, updates: int) -> float:
    """Rate of an update, counted from 0.

    peak (u + 1) / warmup while u < warmup, then peak (1 + cos(pi (u - warmup) / (N - warmup))) / 2,
    which reaches zero at u = N: a run must be judged at its end.
    """
    if update < warmup:
        return peak * (update + 1) / warmup
    progress = (update - warmup) / max(1, updates - warmup)
    return 0.5 * peak * (1.0 + math.cos(math.pi * min(1.0, progress)))
