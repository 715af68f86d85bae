"""How often each caller may call."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass

RATE_HZ = 10.0
BURST = 50
_MOST_CALLERS = 1024


@dataclass
class _Bucket:
    tokens: float
    at_s: float


class RateLimit:
    """One token bucket per caller.

    tokens(t) = min(burst, tokens(t0) + rate (t - t0)); a call takes one.

    Bounded: of more than 1024 callers the one that was quiet longest is forgotten, and begins with
    a full bucket.

    Args:
        rate_hz: Calls per second in the long run.
        burst: Calls at once after a pause.
        now_s: Monotonic time.
    """

    def __init__(
        self,
        *,
        rate_hz: float = RATE_HZ,
        burst: int = BURST,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self.rate_hz = rate_hz
        self._burst = burst
        self._now_s = now_s
        self._buckets: OrderedDict[str, _Bucket] = OrderedDict()

    def take(self, caller: str) -> float:
        """Count a call; give the time until one is possible [s], 0 when this one is."""
        now_s = self._now_s()
        bucket = self._buckets.pop(caller, None) or _Bucket(self._burst, now_s)
        self._buckets[caller] = bucket
        if len(self._buckets) > _MOST_CALLERS:
            self._buckets.popitem(last=False)
        earned = self.rate_hz * (now_s - bucket.at_s)
        bucket.tokens, bucket.at_s = min(self._burst, bucket.tokens + earned), now_s
        if bucket.tokens < 1:
            return (1 - bucket.tokens) / self.rate_hz
        bucket.tokens -= 1
        return 0.0
