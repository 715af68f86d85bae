"""What the runner counts."""

from __future__ import annotations

from collections import defaultdict


class Tally:
    """Counters of one node since it started; by topic where a topic is at fault.

    Written by the worker thread only. Another thread may copy a table whole.
    """

    def __init__(self) -> None:
        self.handled = 0
        self.handle_ns = 0
        self.received = defaultdict[str, int](int)
        self.published = defaultdict[str, int](int)
        self.rejected = defaultdict[str, int](int)
        self.stale = defaultdict[str, int](int)
        self.missing = defaultdict[str, int](int)
