"""What the retargeting service shows of itself, from the status messages that it sends anyway."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator

from common.messages import RetargetStatus
from common.metrics import Increase, Metric, Sample
from common.metrics.table import (
    HAND_ERROR,
    HAND_TURN,
    LIMITED_TICKS,
    SOLVE,
    SOLVER_FAILURES,
)


class Measured:
    """Samples and totals per robot.

    Args:
        robots: Robots of the service.
    """

    def __init__(self, robots: Iterable[str]) -> None:
        self._robots = tuple(robots)
        self._totals = Counter[tuple[Metric, str]]()
        self._failures = Increase()

    def add(self, status: RetargetStatus, robot: str) -> Iterator[Sample]:
        """Take the status of one frame period; one sample per tick and quantity."""
        labels = (robot,)
        for metric, values in (
            (SOLVE, status.solve_time_s),
            (HAND_ERROR, status.hand_error_m),
            (HAND_TURN, status.hand_error_rad),
        ):
            for value in values:
                yield Sample(metric, value, labels)
        self._totals[LIMITED_TICKS, robot] += status.limited_ticks
        self._totals[SOLVER_FAILURES, robot] += self._failures.since_last(
            status.header.cell, status.header.epoch, status.solver_failures
        )

    def levels(self) -> Iterator[Sample]:
        """Totals since the start."""
        for metric in (LIMITED_TICKS, SOLVER_FAILURES):
            for robot in self._robots:
                yield Sample(metric, self._totals[metric, robot], (robot,))
