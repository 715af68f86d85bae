"""Runs of several retargeters on one motion, tick by tick in turn, and what is kept of them."""

from __future__ import annotations

import gc
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.retarget_motions import HandMotion
from benchmarks.retarget_peers import Follower, Vector
from common.clock import TICK_S
from common.se3 import Array, distance
from common.tasks import Obstacle
from services.retarget.reference import TickReference
from services.retarget.robot_model import RobotModel
from services.retarget.whole_body import WholeBodyRetargeter


class Ours:
    """Our retargeter.

    Args:
        model: The robot.
        obstacles: What its links keep away from.
        measures: Feed the last command back as measurement, so that the leash is computed.
    """

    def __init__(
        self, model: RobotModel, *, obstacles: Sequence[Obstacle] = (), measures: bool = False
    ) -> None:
        self._retargeter = WholeBodyRetargeter(model, obstacles)
        self._measured = model.spec.start_positions if measures else None
        self.failures = 0
        self.is_saturated = False

    def step(self, reference: TickReference) -> tuple[Vector, Vector]:
        """One tick, as in `Follower`."""
        motion = self._retargeter.follow(reference, self._measured)
        self.failures += motion.failures
        self.is_saturated = bool(motion.active_limits)
        if self._measured is not None:
            self._measured = motion.positions
        return motion.positions, motion.velocities


@dataclass(frozen=True)
class Run:
    """One retargeter on one or more motions.

    Args:
        times_us: (ticks,) processor time of every step.
        errors_m: (ticks,) distance of the hand from the motion at the end of every tick.
        errors_rad: (ticks,) the same of its orientation.
        saturated: (ticks,) whether a joint of ours stood at a bound; always false of others.
        failures: Levels or programs without solution.
        peak_acceleration: Largest change of velocity, over what the joint is allowed.
    """

    times_us: Array
    errors_m: Array
    errors_rad: Array
    saturated: Array
    failures: int
    peak_acceleration: float

    @property
    def median_us(self) -> float:
        """Median time of a step."""
        return float(np.median(self.times_us))

    @property
    def rms_m(self) -> float:
        """Root mean square of the position error."""
        return float(np.sqrt(np.mean(self.errors_m**2)))

    @property
    def rms_rad(self) -> float:
        """Root mean square of the orientation error."""
        return float(np.sqrt(np.mean(self.errors_rad**2)))


def pool(runs: Sequence[Run]) -> Run:
    """Several runs of one retargeter as one."""
    return Run(
        np.concatenate([run.times_us for run in runs]),
        np.concatenate([run.errors_m for run in runs]),
        np.concatenate([run.errors_rad for run in runs]),
        np.concatenate([run.saturated for run in runs]),
        sum(run.failures for run in runs),
        max(run.peak_acceleration for run in runs),
    )


Entry = tuple[Follower, Sequence[TickReference]]
"""A retargeter and what it is told, tick by tick."""


def run_in_turn(
    model: RobotModel, motion: HandMotion, entries: Mapping[str, Entry]
) -> dict[str, Run]:
    """Let all retargeters take the first tick, then the second, and so on.

    Who begins changes from tick to tick, so that none always finds the caches of the same other.

    Args:
        model: The robot.
        motion: What the hand should do.
        entries: Retargeters by name, each at the start posture.
    """
    ticks = len(motion.targets)
    names = list(entries)
    times_ns = {name: np.zeros(ticks) for name in names}
    q = {name: np.zeros((ticks, model.spec.nv)) for name in names}
    v = {name: np.zeros((ticks + 1, model.spec.nv)) for name in names}
    saturated = {name: np.zeros(ticks, dtype=bool) for name in names}
    gc.collect()
    for tick in range(ticks):
        first = tick % len(names)
        for name in names[first:] + names[:first]:
            follower, references = entries[name]
            reference = references[tick]
            started = time.thread_time_ns()
            positions, velocities = follower.step(reference)
            times_ns[name][tick] = time.thread_time_ns() - started
            q[name][tick], v[name][tick + 1] = positions, velocities
            saturated[name][tick] = isinstance(follower, Ours) and follower.is_saturated
    limits = np.array([joint.acceleration_limit for joint in model.spec.joints])
    runs: dict[str, Run] = {}
    for name, (follower, _) in entries.items():
        errors = np.array(
            [
                distance(T_world_wanted, model.compute_tool_pose(at))
                for T_world_wanted, at in zip(motion.poses[1:], q[name], strict=True)
            ]
        )
        peak = float((np.abs(np.diff(v[name], axis=0)) / (limits * TICK_S)).max())
        runs[name] = Run(
            1e-3 * times_ns[name],
            errors[:, 0],
            errors[:, 1],
            saturated[name],
            follower.failures,
            peak,
        )
    return runs
