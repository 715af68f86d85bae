"""Bounded slots between Zenoh's receive thread and a process's one worker thread.

A Zenoh callback may neither block nor call Zenoh, and every microsecond in it delays all other
topics of the session. So a callback only stores bytes here; decoding happens on the worker thread.
"""

from __future__ import annotations

import threading
from collections import defaultdict, deque
from typing import Any, NamedTuple

from common.messages import Message
from common.topics import TOPICS, Topic, owner_of


class Received(NamedTuple):
    """Bytes as they came from the bus, not decoded yet."""

    topic: Topic
    key: str
    encoding: str
    payload: bytes

    @property
    def owner(self) -> str:
        """Cell or node whose key it came on."""
        return owner_of(self.topic, self.key)


class Handed(NamedTuple):
    """A message of this very process, handed over as it is."""

    topic: Topic
    key: str
    owner: str
    message: Message


class Inbox:
    """All that waits for one reactor. Many threads put, one thread drains.

    Per topic and key at most `topic.depth` messages wait; an older one gives way and is counted,
    so a stalled reader costs bounded memory and never sees a burst of stale data.
    """

    def __init__(self) -> None:
        self.superseded_by_topic = defaultdict[str, int](int)
        self._lock = threading.Lock()
        self._slots: dict[str, dict[str, deque[Received | Handed]]] = {}
        self._events: list[Any] = []
        self._signalled = False
        # Open while something waits. Not a SimpleQueue: CPython 3.11's waits for ever when a signal
        # handler outlasts its timeout, and SIGTERM is such a signal.
        self._wake = threading.Lock()
        self._wake.acquire()

    @property
    def superseded(self) -> int:
        """How many messages gave way to a newer one."""
        return sum(dict(self.superseded_by_topic).values())

    @property
    def waiting_events(self) -> int:
        """How many events wait."""
        return len(self._events)

    def depths(self) -> dict[str, int]:
        """How many messages of each topic wait."""
        with self._lock:
            return {
                name: sum(len(slot) for slot in by_key.values())
                for name, by_key in self._slots.items()
            }

    def open_topic(self, topic: Topic) -> None:
        """Make room for a topic before the first message can come."""
        with self._lock:
            opened = {*self._slots, topic.name}
            # Keep the table's order: episode control is read before what it concerns.
            self._slots = {t.name: self._slots.get(t.name, {}) for t in TOPICS if t.name in opened}

    def put(self, item: Received | Handed) -> None:
        """Store a message. Safe in a Zenoh callback: the lock is held for a swap only."""
        with self._lock:
            by_key = self._slots[item.topic.name]
            slot = by_key.get(item.key)
            if slot is None:
                slot = by_key[item.key] = deque(maxlen=item.topic.depth)
            if len(slot) == item.topic.depth:
                self.superseded_by_topic[item.topic.name] += 1
            slot.append(item)
            self._signal()

    def put_event(self, event: Any) -> None:
        """Store something that must not be lost: a liveliness change, a request, a command."""
        with self._lock:
            self._events.append(event)
            self._signal()

    def wait(self, timeout_s: float) -> bool:
        """Sleep until something waits or the time is over; tell whether something waits."""
        # A negative timeout would be none at all.
        if not self._wake.acquire(timeout=max(0.0, timeout_s)):
            return False
        # It stays open until `drain`, by the same one reader.
        self._wake.release()
        return True

    def drain(self) -> tuple[list[Any], list[Received | Handed]]:
        """Take everything that waits: events first, then messages in the order of the table."""
        with self._lock:
            if not self._signalled:
                return [], []
            self._signalled = False
            self._wake.acquire()
            events, self._events = self._events, []
            received: list[Received | Handed] = []
            for by_key in self._slots.values():
                if by_key:
                    for slot in by_key.values():
                        received.extend(slot)
                    by_key.clear()
        return events, received

    def _signal(self) -> None:
        if not self._signalled:
            self._signalled = True
            self._wake.release()
