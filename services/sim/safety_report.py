"""What the owner of a cell tells others about its guard."""

from __future__ import annotations

from collections.abc import Sequence

from common.errors import LegatoError
from common.messages import (
    Header,
    Message,
    Problem,
    SafetyCounts,
    SafetyState,
    SafetyStatus,
    Tick,
)
from common.safety import SafetyLatch
from common.service import AnyMessage
from services.sim.episode import Episode
from services.sim.hold import Hold

_PERIOD_NS = 1_000_000_000


class SafetyReport:
    """Makes a `SafetyState` when status or fault have changed, and once a second.

    Args:
        cell: The cell.
        latch: Its faults.
    """

    def __init__(self, cell: str, latch: SafetyLatch) -> None:
        self._cell = cell
        self._latch = latch
        self._told: tuple[SafetyStatus, LegatoError | None] = ("stopped", None)
        self._due_ns = 0
        self._counts = SafetyCounts()

    def update(
        self, message: AnyMessage, episode: Episode | None, hold: Hold | None
    ) -> Sequence[Message]:
        """Look at the guard after a message was handled.

        Args:
            message: What was handled.
            episode: The one that it was for, if any.
            hold: The robot after its episode, in real time.
        """
        status = _find_status(episode, hold)
        now = (status, self._latch.fault)
        if now == self._told and not self._is_due(message):
            return ()
        self._told = now
        if episode is not None:
            guard = episode.body.guard
            self._counts = SafetyCounts(
                foreign_messages=episode.writer.foreign, **vars(guard.counts)
            )
        fault = self._latch.fault
        return (
            SafetyState(
                header=Header(cell=self._cell),
                status=status,
                fault=None if fault is None else Problem(**fault.describe()),
                emergency_stop=self._latch.emergency,
                counts=self._counts,
            ),
        )

    def _is_due(self, message: AnyMessage) -> bool:
        if not isinstance(message, Tick) or message.t_mono_ns < self._due_ns:
            return False
        self._due_ns = message.t_mono_ns + _PERIOD_NS
        return True


def _find_status(episode: Episode | None, hold: Hold | None) -> SafetyStatus:
    if hold is not None:
        return hold.body.guard.status
    if episode is None or episode.over:
        # In lockstep time stands still between episodes, and so does the robot.
        return "stopped"
    return episode.body.guard.status
