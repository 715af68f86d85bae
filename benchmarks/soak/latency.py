"""From the camera to the first joint command that knows what it saw, measured on the bus.

A frame leaves the simulation with the stamp t_f. The policy's action repeats t_f and leaves with
t_a. The retargeter takes an action with the next state it answers, so the first command that
answers a state sent at t_a or later is the answer to the frame. All stamps are of one monotonic
clock, because all processes run on one host. A latency is the arrival of that command at a
subscriber, as the simulation is one, less t_f. It has the bus four times, the policy, the solver,
and on average half of the 10 ms from one state to the next in it; not the drawing of the frame.
"""

from __future__ import annotations

import queue
import time
from collections.abc import Iterator

from common.bus import Handed, Inbox, Received, decode
from common.messages import Message, PolicyAction, RobotCommand
from common.topics import topic_of

TOPICS = (topic_of(PolicyAction), topic_of(RobotCommand))
_MOST_WAITING = 10_000
_MOST_OPEN = 100
"""Actions whose command may still come; those of an episode that has ended get none."""


class ArrivalTap(Inbox):
    """Notes when each message arrived; it is decoded later, on the reader's thread."""

    def __init__(self) -> None:
        super().__init__()
        self._arrived: queue.Queue[tuple[int, Received]] = queue.Queue(_MOST_WAITING)
        self.lost = 0

    def put(self, item: Received | Handed) -> None:
        """Note one message. Runs on Zenoh's thread, so it never waits."""
        if isinstance(item, Handed):
            raise TypeError("a tap listens to other processes, whose messages come as bytes")
        try:
            self._arrived.put_nowait((time.monotonic_ns(), item))
        except queue.Full:
            self.lost += 1

    def take_all(self) -> Iterator[tuple[int, Message]]:
        """What has arrived since the last call: when [ns], and what."""
        while True:
            try:
                arrived_ns, item = self._arrived.get_nowait()
            except queue.Empty:
                return
            yield arrived_ns, decode(item.topic, item.encoding, item.payload)


class LatencyMatcher:
    """Finds the command that answers each frame."""

    def __init__(self) -> None:
        self.latencies_s: list[float] = []
        self._open: list[PolicyAction] = []

    def take(self, arrived_ns: int, message: Message) -> None:
        """Take a message as it arrived.

        Args:
            arrived_ns: When, by the monotonic clock of this host.
            message: An action or a command; others are of no importance.
        """
        if isinstance(message, PolicyAction):
            self._open = [*self._open[1 - _MOST_OPEN :], message]
        elif isinstance(message, RobotCommand):
            answered = [action for action in self._open if _answers(message, action)]
            self.latencies_s += [1e-9 * (arrived_ns - a.request_t_mono_ns) for a in answered]
            self._open = [action for action in self._open if action not in answered]


def _answers(command: RobotCommand, action: PolicyAction) -> bool:
    here, there = command.header, action.header
    is_same = (here.cell, here.epoch) == (there.cell, there.epoch)
    return is_same and command.request_t_mono_ns >= there.t_mono_ns
