"""What was wrong, until somebody resets it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from common.errors import EmergencyStopped, InvalidValue, LegatoError, StaleCommand, WrongShape
from common.metrics import Sample
from common.metrics.table import FAULTS

_USUAL = (EmergencyStopped, StaleCommand, WrongShape, InvalidValue)
"""What latches it; shown as 0 before, which the rate of a counter begins with."""


class SafetyLatch:
    """Keeps the first fault of a cell. It outlives episodes; an emergency stop outranks a fault."""

    def __init__(self) -> None:
        self._fault: LegatoError | None = None
        self._latched = Counter({each.code: 0 for each in _USUAL})

    @property
    def fault(self) -> LegatoError | None:
        """Why the robot may not move; None when it may."""
        return self._fault

    @property
    def emergency(self) -> bool:
        """Whether it is an emergency stop."""
        return isinstance(self._fault, EmergencyStopped)

    def engage(self, fault: LegatoError) -> None:
        """Latch a fault."""
        outranks = isinstance(fault, EmergencyStopped) and not self.emergency
        if self._fault is None or outranks:
            self._fault = fault
            self._latched[fault.code] += 1

    def open_episode(self) -> None:
        """A new episode releases every fault but an emergency stop.

        Raises:
            EmergencyStopped: It is latched.
        """
        if isinstance(self._fault, EmergencyStopped):
            # Without the traces of earlier times, which would pile up.
            raise self._fault.with_traceback(None)
        self._fault = None

    def reset(self) -> None:
        """Release whatever is latched."""
        self._fault = None

    def levels(self) -> Iterator[Sample]:
        """How often it was latched, by the code of the fault."""
        for code, count in self._latched.items():
            yield Sample(FAULTS, count, (code,))
