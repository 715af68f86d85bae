"""What the scheduler shows of itself."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import get_args

from common.api import ServiceInfo
from common.messages import LocalMessage, Message, Outcome
from common.metrics import Sample
from common.metrics.table import (
    ABORTED_ATTEMPTS,
    PEER_ALIVE,
    PENDING_TRIALS,
    RUNNING_ATTEMPTS,
    RUNNING_EVALUATIONS,
    TRIALS,
)
from services.control.events import AttemptEnded, TrialEnded
from services.control.lane import EvaluationRun


class Measured:
    """Trials and attempts that have ended since the start."""

    def __init__(self) -> None:
        self._trials: dict[Outcome, int] = dict.fromkeys(get_args(Outcome), 0)
        self._aborted_attempts = 0

    def add(self, events: Iterable[Message | LocalMessage]) -> None:
        """Take what the scheduler tells the edge."""
        for event in events:
            if isinstance(event, TrialEnded):
                self._trials[event.status] += 1
            elif isinstance(event, AttemptEnded):
                self._aborted_attempts += 1

    def levels(
        self, nodes: Iterable[ServiceInfo], runs: Iterable[EvaluationRun], running_attempts: int
    ) -> Iterator[Sample]:
        """Totals, and what stands now.

        Args:
            nodes: Every known node.
            runs: Evaluations that have not ended.
            running_attempts: Trials that a cell has.
        """
        for node in nodes:
            yield Sample(PEER_ALIVE, float(node.alive), (node.kind, node.node))
        for outcome, count in self._trials.items():
            yield Sample(TRIALS, count, (outcome,))
        runs = list(runs)
        yield Sample(ABORTED_ATTEMPTS, self._aborted_attempts)
        yield Sample(RUNNING_EVALUATIONS, len(runs))
        yield Sample(RUNNING_ATTEMPTS, running_attempts)
        yield Sample(PENDING_TRIALS, sum(run.count_pending() for run in runs))
