"""Listening to the bus from the outside, for `legato topic`."""

from __future__ import annotations

import itertools
import queue
import threading
import time
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from common.bus import Bus, BusSettings, Handed, Inbox, Received, open_session
from common.topics import Topic

ROUTER_WAIT_S = 2.0
_MOST_WAITING = 1000


@dataclass(frozen=True)
class Rate:
    """How often one key was seen.

    Args:
        key: Full key without the namespace.
        count: Messages seen.
        rate_hz: Messages per second; of the gaps where there are two messages or more.
        shortest_s: Smallest gap [s].
        longest_s: Largest gap [s].
    """

    key: str
    count: int
    rate_hz: float
    shortest_s: float | None
    longest_s: float | None


class RateTap(Inbox):
    """Notes when each key was seen and keeps no message."""

    def __init__(self) -> None:
        super().__init__()
        self._guard = threading.Lock()
        self._seen_ns: dict[tuple[str, str], list[int]] = {}

    def put(self, item: Received | Handed) -> None:
        """Note one message. Runs on Zenoh's thread."""
        now_ns = time.monotonic_ns()
        with self._guard:
            self._seen_ns.setdefault((item.topic.name, item.key), []).append(now_ns)

    def rates(self, topic: Topic, *, duration_s: float) -> list[Rate]:
        """Rates of every key of a topic."""
        with self._guard:
            seen = {
                key: list(ns) for (name, key), ns in self._seen_ns.items() if name == topic.name
            }
        return [compute_rate(key, ns, duration_s=duration_s) for key, ns in sorted(seen.items())]


class QueueTap(Inbox):
    """Keeps messages in order; a reader that is too slow loses the newest, never the bus."""

    def __init__(self) -> None:
        super().__init__()
        self._queue: queue.Queue[Received] = queue.Queue(_MOST_WAITING)
        self.lost = 0

    def put(self, item: Received | Handed) -> None:
        """Keep one message. Runs on Zenoh's thread, so it never waits."""
        if isinstance(item, Handed):
            raise TypeError("a tap listens to other processes, whose messages come as bytes")
        try:
            self._queue.put_nowait(item)
        except queue.Full:
            self.lost += 1

    def take(self, timeout_s: float) -> Received | None:
        """The next message, or None when none comes in time."""
        try:
            return self._queue.get(timeout=timeout_s)
        except queue.Empty:
            return None


def compute_rate(key: str, seen_ns: Sequence[int], *, duration_s: float) -> Rate:
    """Rate and gaps from the times at which a key was seen.

    rate = (n - 1) / (t_n - t_1) for two messages or more, else n / duration.
    """
    gaps_s = [(b - a) * 1e-9 for a, b in itertools.pairwise(seen_ns)]
    spread_s = sum(gaps_s)
    rate_hz = len(gaps_s) / spread_s if spread_s > 0 else len(seen_ns) / duration_s
    return Rate(
        key=key,
        count=len(seen_ns),
        rate_hz=rate_hz,
        shortest_s=min(gaps_s, default=None),
        longest_s=max(gaps_s, default=None),
    )


@contextmanager
def open_tap(
    settings: BusSettings, tap: Inbox, topics: Sequence[Topic], *, owner: str = "*"
) -> Generator[None, None, None]:
    """Let messages of some topics fall into a tap.

    Raises:
        RouterUnreachable: No router within 2 s.
    """
    with open_session(settings, wait_s=ROUTER_WAIT_S) as session, Bus(session) as bus:
        for topic in topics:
            bus.subscribe(topic, tap, owner=owner)
        yield
