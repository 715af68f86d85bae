"""Whether a data set is fit to learn from: hashes, gaps, jumps, stillness, skew, replay."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from common.datasets.replay import replay_errors
from common.datasets.spec import IMAGES, DatasetSpec, Rows
from common.datasets.store import Episode, EpisodeStore
from common.se3 import distance, pose_from_wire

JUMP_M = 0.10
"""Per row, that is 1 m/s at 10 Hz: no hand moves a gripper faster."""
JUMP_RAD = 0.5
STILL_SHARE = 0.5
"""A demonstration that stands still longer teaches to stand still."""
SKEW_TICKS = 1
REPLAY_M = 1e-4
REPLAY_RAD = 1e-3


@dataclass(frozen=True)
class Problem:
    """Something wrong with an episode."""

    episode: int
    check: str
    detail: str


@dataclass(frozen=True)
class ColumnStatistics:
    """Least, mean and largest number of a column."""

    column: str
    unit: str
    least: float
    mean: float
    largest: float


@dataclass(frozen=True)
class QualityReport:
    """What was found.

    Args:
        episodes: How many there are.
        rows: Of all episodes.
        failures: Episodes whose trial failed.
        measured: Largest values over all episodes, by name with unit.
        statistics: Of every column.
        not_checked: Checks that need a column which the data set does not have.
        problems: Everything wrong, by episode.
    """

    episodes: int
    rows: int
    failures: int
    measured: dict[str, float]
    statistics: list[ColumnStatistics]
    not_checked: list[str]
    problems: list[Problem]

    def to_json(self) -> dict[str, Any]:
        """As plain data."""
        return asdict(self)


@dataclass(frozen=True)
class Finding:
    """What one check measures on one episode, and what is wrong with it."""

    measured: dict[str, float]
    problem: str | None = None


@dataclass(frozen=True)
class Check:
    """One check and the columns it needs."""

    name: str
    columns: tuple[str, ...]
    run: Callable[[Episode, DatasetSpec], Finding]


def check_quality(store: EpisodeStore) -> QualityReport:
    """Check every episode of a data set."""
    known = {column.name for column in store.spec.columns}
    runnable = [check for check in CHECKS if known.issuperset(check.columns)]
    problems = [
        Problem(number, "hash", "the rows are not what was written") for number in store.verify()
    ]
    measured: dict[str, float] = {}
    for number, episode in enumerate(store):
        for check in runnable:
            finding = check.run(episode, store.spec)
            for name, value in finding.measured.items():
                measured[name] = max(value, measured.get(name, value))
            if finding.problem is not None:
                problems.append(Problem(number, check.name, finding.problem))
    return QualityReport(
        episodes=len(store),
        rows=store.rows,
        failures=sum(1 for episode in store.episodes if episode.outcome == "failure"),
        measured=measured,
        statistics=list(_describe_columns(store)),
        not_checked=[check.name for check in CHECKS if check not in runnable],
        problems=sorted(problems, key=lambda problem: problem.episode),
    )


def _check_numbers(episode: Episode, spec: DatasetSpec) -> Finding:
    """Every number finite, every quaternion of length 1, every flag 0 or 1."""
    for column in spec.columns:
        values = episode[column.name]
        if column.dtype in ("f32", "f64") and not np.isfinite(values).all():
            return Finding({}, f"{column.name} has a value that is not a number")
        if "quaternion" in column.unit:
            lengths = np.sqrt(np.sum(np.square(values[:, 3:].astype(np.float64)), axis=1))
            if np.abs(lengths - 1.0).max() > 1e-3:
                return Finding({}, f"{column.name} has a quaternion that is not of length 1")
        if column.name in ("grasp", "gripped") and values.max() > 1:
            return Finding({}, f"{column.name} has a value that is neither 0 nor 1")
    return Finding({})


def _check_gaps(episode: Episode, spec: DatasetSpec) -> Finding:
    """Frames that follow each other at the rate of the data set."""
    gaps = np.diff(_numbers(episode["frame_step"])) / (spec.tick_rate_hz / spec.rate_hz)
    wrong = np.flatnonzero(gaps != 1.0)
    dropped = float(np.maximum(gaps - 1.0, 0.0).sum())
    problem = f"{dropped:g} frames dropped, first after row {wrong[0]}" if len(wrong) else None
    return Finding({"dropped frames": dropped}, problem)


def _check_skew(episode: Episode, spec: DatasetSpec) -> Finding:
    """Images and robot positions of one moment."""
    ticks = np.abs(_numbers(episode["state_step"]) - _numbers(episode["frame_step"])).max()
    problem = f"images and positions are {ticks:g} ticks apart" if ticks > SKEW_TICKS else None
    return Finding({"image to state skew, ticks": float(ticks)}, problem)


def _check_jumps(episode: Episode, spec: DatasetSpec) -> Finding:
    """A tool that moves, and does not jump."""
    poses = [pose_from_wire(wire) for wire in episode["tool_pose"].tolist()]
    steps = [distance(one, other) for one, other in itertools.pairwise(poses)]
    far_m, far_rad = np.array([(0.0, 0.0), *steps]).max(axis=0).tolist()
    jumped = far_m > JUMP_M or far_rad > JUMP_RAD
    problem = f"the tool jumps by {1e3 * far_m:.0f} mm and {far_rad:.2f} rad" if jumped else None
    return Finding({"tool step, m": far_m, "tool step, rad": far_rad}, problem)


def _check_stillness(episode: Episode, spec: DatasetSpec) -> Finding:
    """How much of it stands still: actions that are exactly zero, the last one apart."""
    actions = episode["action"]
    still = np.count_nonzero(_numbers(actions[:-1]), axis=1) == 0
    share = float(np.mean(still)) if len(actions) > 1 else 1.0
    problem = f"{share:.0%} of the actions are zero" if share > STILL_SHARE else None
    if np.count_nonzero(_numbers(actions[-1])):
        problem = "the last action is not zero"
    return Finding({"still share": share}, problem)


def _check_replay(episode: Episode, spec: DatasetSpec) -> Finding:
    """Actions that lead from the start pose along the recorded reference."""
    errors_m, errors_rad = replay_errors(episode, spec)
    worst_m, worst_rad = float(errors_m.max()), float(errors_rad.max())
    wrong = np.flatnonzero((errors_m > REPLAY_M) | (errors_rad > REPLAY_RAD))
    problem = None
    if len(wrong):
        problem = (
            f"replayed actions leave the recorded reference at row {wrong[0]} and end up "
            f"{1e3 * worst_m:.1f} mm, {worst_rad:.3f} rad away"
        )
    return Finding({"replay error, m": worst_m, "replay error, rad": worst_rad}, problem)


CHECKS = (
    Check("numbers", (), _check_numbers),
    Check("gaps", ("frame_step",), _check_gaps),
    Check("skew", ("frame_step", "state_step"), _check_skew),
    Check("jumps", ("tool_pose",), _check_jumps),
    Check("stillness", ("action",), _check_stillness),
    Check("replay", ("action", "reference_pose", "frame_step"), _check_replay),
)


def _describe_columns(store: EpisodeStore) -> Iterator[ColumnStatistics]:
    if store.rows == 0:
        return
    for column in store.spec.columns:
        values = store.column(column.name)
        if column.name == IMAGES:
            # Episode by episode: a mean over all of them at once needs far more memory.
            parts = [episode[IMAGES] for episode in store]
            least, largest = min(p.min() for p in parts), max(p.max() for p in parts)
            mean = sum(float(p.mean()) * len(p) for p in parts) / store.rows
        else:
            least, largest, mean = values.min(), values.max(), float(_numbers(values).mean())
        yield ColumnStatistics(column.name, column.unit, float(least), mean, float(largest))


def _numbers(values: Rows) -> np.ndarray[Any, np.dtype[np.float64]]:
    return values.astype(np.float64)
