"""From the worker thread to the browsers that follow an evaluation."""

from __future__ import annotations

import asyncio
import threading
from collections import defaultdict
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass

_MOST_WAITING = 1024


@dataclass(frozen=True)
class Change:
    """An evaluation changed.

    Args:
        trial: The trial that changed it, if it was one.
        closing: Nothing more will come: the process stops.
    """

    trial: int | None = None
    closing: bool = False


class Subscription:
    """What one follower has not seen yet.

    Bounded: a follower that does not read loses the oldest changes. It still sees the whole
    evaluation in its next event, only not every trial on its own.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._queue: asyncio.Queue[Change] = asyncio.Queue(_MOST_WAITING)

    @property
    def is_behind(self) -> bool:
        """Whether changes wait to be taken."""
        return not self._queue.empty()

    async def next_change(self, timeout_s: float) -> Change | None:
        """Wait for a change; None when the time is over."""
        try:
            return await asyncio.wait_for(self._queue.get(), timeout_s)
        except TimeoutError:
            return None

    def offer(self, change: Change) -> None:
        """Hand a change over. From any thread."""
        self._loop.call_soon_threadsafe(self._put, change)

    def _put(self, change: Change) -> None:
        if self._queue.full():
            self._queue.get_nowait()
        self._queue.put_nowait(change)


class Subscriptions:
    """Everyone who follows an evaluation now."""

    def __init__(self) -> None:
        # Held while a change is handed over: a follower's loop outlives its subscription.
        self._lock = threading.Lock()
        self._closing = False
        self._followers: defaultdict[str, set[Subscription]] = defaultdict(set)

    @contextmanager
    def follow(self, evaluation: str) -> Generator[Subscription, None, None]:
        """Receive the changes of an evaluation on the running event loop."""
        subscription = Subscription(asyncio.get_running_loop())
        with self._lock:
            self._followers[evaluation].add(subscription)
            if self._closing:
                subscription.offer(Change(closing=True))
        try:
            yield subscription
        finally:
            with self._lock:
                self._followers[evaluation].discard(subscription)
                if not self._followers[evaluation]:
                    del self._followers[evaluation]

    def notify(self, evaluation: str, trial: int | None) -> None:
        """Tell the followers of an evaluation that it changed. From any thread."""
        with self._lock:
            for subscription in self._followers.get(evaluation, ()):
                subscription.offer(Change(trial))

    def close(self) -> None:
        """Send every follower away, now and later, so that the process can stop."""
        with self._lock:
            self._closing = True
            for followers in self._followers.values():
                for subscription in followers:
                    subscription.offer(Change(closing=True))

    def __len__(self) -> int:
        """How many followers there are."""
        with self._lock:
            return sum(len(followers) for followers in self._followers.values())
