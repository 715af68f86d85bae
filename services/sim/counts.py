"""What the simulation counts over all its episodes, the running one included."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeAlias, get_args

from common.clock import LockstepBarrier, RealtimePacer
from common.messages import Outcome
from common.metrics import Metric, Sample
from common.metrics.table import (
    CAMERA,
    CLAMPED_TICKS,
    COASTED_TICKS,
    EPISODES,
    HELD_TICKS,
    MISSED_FRAMES,
    PHYSICS,
    RESENDS,
    SKIPPED_TICKS,
)
from common.safety import GuardCounts
from services.sim.measurements import Measurements

Series: TypeAlias = tuple[Metric, tuple[str, ...]]
"""A metric and the values of its labels."""

_SERIES: tuple[Series, ...] = (
    (HELD_TICKS, ()),
    (COASTED_TICKS, ()),
    *((CLAMPED_TICKS, (limit,)) for limit in ("position", "velocity", "acceleration")),
    *((metric, ()) for metric in (MISSED_FRAMES, SKIPPED_TICKS, RESENDS, CAMERA, PHYSICS)),
)


@dataclass(frozen=True)
class LiveCounts:
    """Where a running episode counts; small, so that it may outlive its world."""

    measured: Measurements
    barrier: LockstepBarrier
    pacer: RealtimePacer
    guard: GuardCounts

    def read(self) -> dict[Series, float]:
        """Counts of the episode so far."""
        return {
            (HELD_TICKS, ()): self.measured.held_ticks,
            (COASTED_TICKS, ()): self.guard.coasted_ticks,
            (CLAMPED_TICKS, ("position",)): self.guard.position_clamps,
            (CLAMPED_TICKS, ("velocity",)): self.guard.velocity_clamps,
            (CLAMPED_TICKS, ("acceleration",)): self.guard.acceleration_clamps,
            (MISSED_FRAMES, ()): self.measured.missed_frames,
            (SKIPPED_TICKS, ()): self.pacer.skipped,
            (RESENDS, ()): self.barrier.resends,
            (CAMERA, ()): self.measured.camera_s,
            (PHYSICS, ()): self.measured.physics_s,
        }


class Counts:
    """Totals over episodes."""

    def __init__(self) -> None:
        self._before = Counter[Series]()
        self._live: LiveCounts | None = None
        self._outcomes: dict[Outcome, int] = dict.fromkeys(get_args(Outcome), 0)

    def follow(self, live: LiveCounts) -> None:
        """Another episode begins."""
        if self._live is not None:
            self._before.update(self._live.read())
        self._live = live

    def end(self, outcome: Outcome) -> None:
        """An episode has ended by itself."""
        self._outcomes[outcome] += 1

    def levels(self) -> Iterator[Sample]:
        """Totals since the start."""
        live = {} if self._live is None else self._live.read()
        for metric, labels in _SERIES:
            count = self._before[metric, labels] + live.get((metric, labels), 0.0)
            yield Sample(metric, count, labels)
        for outcome, count in self._outcomes.items():
            yield Sample(EPISODES, count, (outcome,))
