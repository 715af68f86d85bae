"""From trials to the numbers of a report. A pure function, shared by REST and offline runs."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from common.api import CellSummary, EvaluationRequest, StageCounts, TrialStatus
from common.messages import STAGES, TrialResult
from common.statistics import median, wilson_interval95


@dataclass(frozen=True)
class TrialFacts:
    """What a summary needs of one trial. Measurements are None without a result.

    Args:
        task: Task name.
        robot: Robot name.
        policy: Policy name.
        index: i of "trial i".
        status: Where the trial stands.
        grasped: Whether it came to that stage of `StagesReached`.
        lifted: The same.
        placed: The same.
        released: The same.
        hand_error_median_m: Median of the hand error over the trial [m].
        hand_error_p95_m: 95th percentile of the hand error over the trial [m].
        hand_scaling_mean: Share of the hand task achieved, mean over the trial.
        hand_scaling_least: The smallest of them.
        limited_share: Share of ticks with an active limit.
        solver_failures: Ticks in which the retargeter fell back.
        solve_time_median_s: Median of the retargeting step's time over the trial [s].
        solve_time_p99_s: Its 99th percentile [s].
        sim_time_s: Simulated time [s].
        wall_time_s: Time it took [s].
        trace_sha256: Hash of the trace.
    """

    task: str
    robot: str
    policy: str
    index: int
    status: TrialStatus
    grasped: bool | None = None
    lifted: bool | None = None
    placed: bool | None = None
    released: bool | None = None
    hand_error_median_m: float | None = None
    hand_error_p95_m: float | None = None
    hand_scaling_mean: float | None = None
    hand_scaling_least: float | None = None
    limited_share: float | None = None
    solver_failures: int | None = None
    solve_time_median_s: float | None = None
    solve_time_p99_s: float | None = None
    sim_time_s: float | None = None
    wall_time_s: float | None = None
    trace_sha256: str | None = None


def measurements_of(result: TrialResult | None) -> dict[str, Any]:
    """The fields of `TrialFacts` that come from a result; none without one."""
    if result is None:
        return {}
    return {
        **result.stages.model_dump(),
        "hand_error_median_m": result.hand_error_m.median,
        "hand_error_p95_m": result.hand_error_m.p95,
        "hand_scaling_mean": result.hand_scaling_mean,
        "hand_scaling_least": result.hand_scaling_least,
        "limited_share": result.limited_share,
        "solver_failures": result.solver_failures,
        "solve_time_median_s": result.solve_time_s.median,
        "solve_time_p99_s": result.solve_time_s.p99,
        "sim_time_s": result.sim_time_s,
        "wall_time_s": result.wall_time_s,
        "trace_sha256": result.trace_sha256,
    }


def summarise(request: EvaluationRequest, trials: Iterable[TrialFacts]) -> list[CellSummary]:
    """One summary per task × robot × policy, in the order of the request.

    Args:
        request: The grid.
        trials: Its trials in any order; those that are not there yet count as pending.
    """
    lanes: dict[tuple[str, str, str], list[TrialFacts]] = {
        (task, robot, policy): []
        for task in request.tasks
        for robot in request.robots
        for policy in request.policy_names
    }
    for trial in trials:
        lanes[trial.task, trial.robot, trial.policy].append(trial)
    return [_summarise_lane(lane, facts, request.trials) for lane, facts in lanes.items()]


def _summarise_lane(
    lane: tuple[str, str, str], facts: list[TrialFacts], trials: int
) -> CellSummary:
    task, robot, policy = lane
    count = {status: sum(f.status == status for f in facts) for status in _ENDED}
    done = sum(count.values())
    hashes: list[str | None] = [None] * trials
    for fact in facts:
        hashes[fact.index] = fact.trace_sha256
    sim_s, wall_s = (
        sum(_known(facts, lambda f: f.sim_time_s)),
        sum(_known(facts, lambda f: f.wall_time_s)),
    )
    return CellSummary(
        task=task,
        robot=robot,
        policy=policy,
        trials=trials,
        done=done,
        successes=count["success"],
        failures=count["failure"],
        aborted=count["aborted"],
        success_rate=count["success"] / done if done else None,
        interval95=wilson_interval95(count["success"], done),
        stages=StageCounts(
            **{stage: sum(bool(getattr(f, stage)) for f in facts) for stage in STAGES}
        ),
        median_hand_error_m=median(_known(facts, lambda f: f.hand_error_median_m)),
        p95_hand_error_m=median(_known(facts, lambda f: f.hand_error_p95_m)),
        mean_hand_scaling=_mean(_known(facts, lambda f: f.hand_scaling_mean)),
        least_hand_scaling=min(_known(facts, lambda f: f.hand_scaling_least), default=None),
        limited_share=_mean(_known(facts, lambda f: f.limited_share)),
        solver_failures=sum(f.solver_failures or 0 for f in facts),
        median_solve_time_s=median(_known(facts, lambda f: f.solve_time_median_s)),
        p99_solve_time_s=median(_known(facts, lambda f: f.solve_time_p99_s)),
        real_time_factor=sim_s / wall_s if wall_s > 0 else None,
        trace_sha256=hashes,
    )


def _known(facts: list[TrialFacts], measured: Callable[[TrialFacts], float | None]) -> list[float]:
    """A measurement of all trials that have it."""
    return [value for fact in facts if (value := measured(fact)) is not None]


def _mean(values: list[float]) -> float | None:
    return sum(values) / len(values) if values else None


_ENDED: tuple[TrialStatus, ...] = ("success", "failure", "aborted")
