"""The trials of one evaluation that wait for a cell."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

from common.api import EvaluationRequest
from services.control.events import SubmitEvaluation, TrialSpec
from services.control.nodes import Need, NodeRegistry


@dataclass
class Lane:
    """One task × robot × policy: its pending trials, lowest index first.

    Args:
        needs: The nodes an episode of it takes.
        pending: Heap of (trial id, trial); ids grow with the index.
        held_until_ns: No trial is handed out before this time.
        missing: Who is missing now.
        missing_since_ns: Since when somebody is.
    """

    needs: tuple[Need, ...]
    pending: list[tuple[int, TrialSpec]] = field(default_factory=list[tuple[int, TrialSpec]])
    held_until_ns: int = 0
    missing: tuple[str, ...] = ()
    missing_since_ns: int | None = None

    def push(self, trial: TrialSpec) -> None:
        """Let a trial wait."""
        heapq.heappush(self.pending, (trial.id, trial))

    def pop(self) -> TrialSpec:
        """Take the first trial."""
        return heapq.heappop(self.pending)[1]

    def look(self, registry: NodeRegistry, now_ns: int) -> None:
        """Note who is missing and since when."""
        self.missing = registry.missing(self.needs) if self.pending else ()
        if not self.missing:
            self.missing_since_ns = None
        elif self.missing_since_ns is None:
            self.missing_since_ns = now_ns

    def has_waited(self, limit_s: float, now_ns: int) -> bool:
        """Whether somebody has been missing for too long."""
        since_ns = self.missing_since_ns
        return since_ns is not None and (now_ns - since_ns) * 1e-9 >= limit_s


def needs_of(trial: TrialSpec) -> tuple[Need, ...]:
    """The nodes an episode of this trial takes."""
    return (
        Need("sim"),
        Need("retarget", ("robots", trial.robot)),
        Need("gripper"),
        Need("policy", ("policies", trial.policy)),
    )


class EvaluationRun:
    """An evaluation as the scheduler sees it."""

    def __init__(self, submitted: SubmitEvaluation) -> None:
        self.id = submitted.evaluation
        self.request: EvaluationRequest = submitted.request
        self.waiting: tuple[str, ...] = ()
        self._lanes: dict[tuple[str, str, str], Lane] = {}
        for trial in submitted.trials:
            self.put_back(trial)

    def put_back(self, trial: TrialSpec, *, not_before_ns: int = 0) -> None:
        """Let a trial wait, and its lane pause until a time."""
        key = (trial.task, trial.robot, trial.policy)
        lane = self._lanes.get(key)
        if lane is None:
            lane = self._lanes[key] = Lane(needs_of(trial))
        lane.push(trial)
        lane.held_until_ns = max(lane.held_until_ns, not_before_ns)

    @property
    def has_pending(self) -> bool:
        """Whether any trial waits."""
        return any(lane.pending for lane in self._lanes.values())

    def count_pending(self) -> int:
        """How many trials wait."""
        return sum(len(lane.pending) for lane in self._lanes.values())

    def look(self, registry: NodeRegistry, now_ns: int, *, unreset: tuple[str, ...] = ()) -> bool:
        """Note who is missing; tell whether that changed.

        Args:
            registry: Who is there.
            now_ns: Monotonic time.
            unreset: What its trials wait for besides: cells that are stopped.
        """
        before = self.waiting
        for lane in self._lanes.values():
            lane.look(registry, now_ns)
        named = [name for lane in self._lanes.values() for name in lane.missing]
        self.waiting = tuple(dict.fromkeys([*named, *(unreset if self.has_pending else ())]))
        return self.waiting != before

    def take_next(
        self, registry: NodeRegistry, load: Counter[str], now_ns: int, *, cell: str
    ) -> tuple[TrialSpec, dict[str, str]] | None:
        """Take the first trial all of whose nodes are there and may serve a cell.

        Returns:
            The trial and its nodes by kind, without the simulation: the caller has the cell.
        """
        waiting = [
            lane for lane in self._lanes.values() if lane.pending and lane.held_until_ns <= now_ns
        ]
        for lane in sorted(waiting, key=lambda lane: lane.pending[0][0]):
            nodes = registry.choose(lane.needs, load, cell=cell)
            if nodes is not None:
                return lane.pop(), nodes
        return None

    def take_overdue(
        self, limit_s: float, now_ns: int
    ) -> Iterator[tuple[TrialSpec, tuple[str, ...]]]:
        """Take every trial whose nodes have been missing for too long, and say who."""
        for lane in self._lanes.values():
            if lane.has_waited(limit_s, now_ns):
                while lane.pending:
                    yield lane.pop(), lane.missing
