"""What is measured during an episode, and its summary."""

from __future__ import annotations

from dataclasses import dataclass, field

from common.clock import TICK_S
from common.messages import (
    Distribution,
    Outcome,
    PolicyAction,
    RetargetStatus,
    StagesReached,
    TrialResult,
    WallTimes,
)
from common.statistics import quantile


@dataclass(frozen=True)
class Ending:
    """How an episode ended."""

    outcome: Outcome
    reason: str
    failed_conditions: tuple[str, ...] = ()


@dataclass
class Measurements:
    """Samples per tick and per action, and wall times."""

    hand_error_m: list[float] = field(default_factory=list[float])
    hand_error_rad: list[float] = field(default_factory=list[float])
    hand_scaling: list[float] = field(default_factory=list[float])
    solve_time_s: list[float] = field(default_factory=list[float])
    inference_s: list[float] = field(default_factory=list[float])
    limited_ticks: int = 0
    solver_failures: int = 0
    physics_s: float = 0.0
    camera_s: float = 0.0
    held_ticks: int = 0
    missed_frames: int = 0

    def add_status(self, status: RetargetStatus) -> None:
        """Take the retargeter's report of the last ticks."""
        self.hand_error_m += status.hand_error_m
        self.hand_error_rad += status.hand_error_rad
        self.hand_scaling += status.hand_scaling
        self.solve_time_s += status.solve_time_s
        self.limited_ticks += status.limited_ticks
        # Counted over the episode: in real time a lost status loses no failure.
        self.solver_failures = status.solver_failures

    def add_action(self, action: PolicyAction) -> None:
        """Take one report of the policy."""
        self.inference_s.append(action.inference_s)

    def wall_times(self, wall_time_s: float) -> WallTimes:
        """Where the wall time went."""
        return WallTimes(
            physics_s=self.physics_s,
            camera_s=self.camera_s,
            waiting_s=max(0.0, wall_time_s - self.physics_s - self.camera_s),
            solve_s=sum(self.solve_time_s),
            inference_s=sum(self.inference_s),
        )

    def result(
        self,
        ending: Ending,
        *,
        ticks: int,
        wall_time_s: float,
        stages: StagesReached,
        goal_distance_m: float,
        resends: int,
        trace_sha256: str,
    ) -> TrialResult:
        """All of it, with how the episode ended."""
        scaling = self.hand_scaling
        return TrialResult(
            outcome=ending.outcome,
            reason=ending.reason,
            failed_conditions=list(ending.failed_conditions),
            ticks=ticks,
            sim_time_s=ticks * TICK_S,
            wall_time_s=wall_time_s,
            stages=stages,
            goal_distance_m=goal_distance_m,
            hand_error_m=_distribution(self.hand_error_m),
            hand_error_rad=_distribution(self.hand_error_rad),
            hand_scaling_mean=min(1.0, sum(scaling) / len(scaling)) if scaling else 0.0,
            hand_scaling_least=min(scaling, default=0.0),
            limited_share=self.limited_ticks / len(scaling) if scaling else 0.0,
            solver_failures=self.solver_failures,
            solve_time_s=_distribution(self.solve_time_s),
            inference_s=_distribution(self.inference_s),
            wall_times=self.wall_times(wall_time_s),
            held_ticks=self.held_ticks,
            missed_frames=self.missed_frames,
            resends=resends,
            trace_sha256=trace_sha256,
        )


def _distribution(samples: list[float]) -> Distribution:
    """Median, high percentiles and largest value; zeros when nothing was measured."""
    return Distribution(
        median=quantile(samples, 0.5) or 0.0,
        p95=quantile(samples, 0.95) or 0.0,
        p99=quantile(samples, 0.99) or 0.0,
        largest=max(samples, default=0.0),
    )
