"""Time in the two modes: a barrier for lockstep, deadlines for real time."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

TICK_S = 0.01
"""Control period: retargeting, gripper driver and joint commands run at 100 Hz."""
FRAME_TICKS = 10
"""Ticks between two stereo frames and policy actions: 10 Hz."""

_NS = 1_000_000_000


def closes_frame(step: int) -> bool:
    """Whether a tick is the last one before the next stereo frame."""
    return (step + 1) % FRAME_TICKS == 0


@dataclass(frozen=True)
class BarrierVerdict:
    """What a silent barrier asks for: nothing, a resend, or the end of the episode."""

    resend: bool = False
    overdue: tuple[str, ...] = ()


class LockstepBarrier:
    """Who has answered for the current tick, and what to do about who has not.

    Wall time enters only here and only decides about resending and giving up, never about a
    result: that is what makes a lockstep trace independent of scheduling.

    Args:
        resend_s: Send the tick again after this much silence.
        deadline_s: Give up after this much silence.
    """

    def __init__(self, *, resend_s: float, deadline_s: float) -> None:
        self._resend_ns = int(resend_s * _NS)
        self._deadline_ns = int(deadline_s * _NS)
        self._missing: set[str] = set()
        self._opened_ns: int | None = None
        self._sent_ns = 0
        self.resends = 0

    @property
    def complete(self) -> bool:
        """Whether everything expected has arrived."""
        return not self._missing

    def open(self, expected: Iterable[str]) -> None:
        """Start waiting for one answer of each kind."""
        self._missing = set(expected)
        self._opened_ns = None

    def arrive(self, kind: str) -> None:
        """Note an answer. A second one of the same kind changes nothing."""
        self._missing.discard(kind)

    def check(self, now_ns: int) -> BarrierVerdict:
        """Judge the silence so far.

        Args:
            now_ns: This process's monotonic clock. The first check after `open` starts the count.
        """
        if not self._missing:
            return BarrierVerdict()
        if self._opened_ns is None:
            self._opened_ns = self._sent_ns = now_ns
            return BarrierVerdict()
        if now_ns - self._opened_ns >= self._deadline_ns:
            return BarrierVerdict(overdue=tuple(sorted(self._missing)))
        if now_ns - self._sent_ns >= self._resend_ns:
            self._sent_ns = now_ns
            self.resends += 1
            return BarrierVerdict(resend=True)
        return BarrierVerdict()


class RealtimePacer:
    """Deadlines `start + n period` on a monotonic clock; a late step does not shift the rest.

    Args:
        period_s: Time between two steps.
        max_behind: Steps one may be late before the missed ones are given up and counted.
    """

    def __init__(self, *, period_s: float, max_behind: int = 5) -> None:
        self._period_ns = int(period_s * _NS)
        self._max_behind = max_behind
        self._next_ns: int | None = None
        self.skipped = 0

    def due(self, now_ns: int) -> bool:
        """Tell whether a step is due now, and if so move on to the next deadline."""
        if self._next_ns is None:
            self._next_ns = now_ns
        if now_ns < self._next_ns:
            return False
        behind = (now_ns - self._next_ns) // self._period_ns
        if behind > self._max_behind:
            self.skipped += behind
            self._next_ns += behind * self._period_ns
        self._next_ns += self._period_ns
        return True
