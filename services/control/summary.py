"""From trials to the numbers of a report. A pure function, shared by REST and offline runs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from common.api import CellSummary, EvaluationRequest, TrialStatus
from common.messages import TrialResult
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
        hand_error_median_m: Median of the hand error over the trial [m].
        hand_error_p95_m: 95th percentile of the hand error over the trial [m].
        sim_time_s: Simulated time [s].
        wall_time_s: Time it took [s].
        trace_sha256: Hash of the trace.
    """

    task: str
    robot: str
    policy: str
    index: int
    status: TrialStatus
    hand_error_median_m: float | None = None
    hand_error_p95_m: float | None = None
    sim_time_s: float | None = None
    wall_time_s: float | None = None
    trace_sha256: str | None = None


def measurements_of(result: TrialResult | None) -> dict[str, float | str | None]:
    """The fields of `TrialFacts` that come from a result."""
    return {
        "hand_error_median_m": None if result is None else result.hand_error_m.median,
        "hand_error_p95_m": None if result is None else result.hand_error_m.p95,
        "sim_time_s": None if result is None else result.sim_time_s,
        "wall_time_s": None if result is None else result.wall_time_s,
        "trace_sha256": None if result is None else result.trace_sha256,
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
    sim_s = sum(f.sim_time_s for f in facts if f.sim_time_s is not None)
    wall_s = sum(f.wall_time_s for f in facts if f.wall_time_s is not None)
    medians = [f.hand_error_median_m for f in facts if f.hand_error_median_m is not None]
    p95s = [f.hand_error_p95_m for f in facts if f.hand_error_p95_m is not None]
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
        median_hand_error_m=median(medians),
        p95_hand_error_m=median(p95s),
        real_time_factor=sim_s / wall_s if wall_s > 0 else None,
        trace_sha256=hashes,
    )


_ENDED: tuple[TrialStatus, ...] = ("success", "failure", "aborted")
