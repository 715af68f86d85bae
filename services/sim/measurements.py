"""What is measured during an episode, and its summary."""

from __future__ import annotations

import time
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field

from common.messages import Distribution, PolicyAction, RetargetStatus, StageTimes
from common.statistics import quantile


@dataclass
class Measurements:
    """Samples per tick and per action, and wall time per stage."""

    hand_error_m: list[float] = field(default_factory=list[float])
    hand_error_rad: list[float] = field(default_factory=list[float])
    solve_time_s: list[float] = field(default_factory=list[float])
    inference_s: list[float] = field(default_factory=list[float])
    physics_s: float = 0.0
    camera_s: float = 0.0
    held_ticks: int = 0
    missed_frames: int = 0

    def add_status(self, status: RetargetStatus) -> None:
        """Take the retargeter's report of the last ticks."""
        self.hand_error_m += status.hand_error_m
        self.hand_error_rad += status.hand_error_rad
        self.solve_time_s += status.solve_time_s

    def add_action(self, action: PolicyAction) -> None:
        """Take one report of the policy."""
        self.inference_s.append(action.inference_s)

    @contextmanager
    def physics(self) -> Generator[None]:
        """Count the time of a block as physics."""
        started = time.perf_counter()
        yield
        self.physics_s += time.perf_counter() - started

    @contextmanager
    def camera(self) -> Generator[None]:
        """Count the time of a block as camera."""
        started = time.perf_counter()
        yield
        self.camera_s += time.perf_counter() - started

    def stages(self, wall_time_s: float) -> StageTimes:
        """Where the wall time went."""
        return StageTimes(
            physics_s=self.physics_s,
            camera_s=self.camera_s,
            waiting_s=max(0.0, wall_time_s - self.physics_s - self.camera_s),
            solve_s=sum(self.solve_time_s),
            inference_s=sum(self.inference_s),
        )


def distribution(samples: list[float]) -> Distribution:
    """Median, 95th percentile and largest value; zeros when nothing was measured."""
    return Distribution(
        median=quantile(samples, 0.5) or 0.0,
        p95=quantile(samples, 0.95) or 0.0,
        largest=max(samples, default=0.0),
    )
