"""The retargeter along a recorded demonstration, without dynamics."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from common.clock import FRAME_TICKS
from common.se3 import Array, distance
from common.tasks import Obstacle
from common.tasks.recording import Recording
from services.retarget.level import Mask
from services.retarget.reference import GripperReference, Lead
from services.retarget.robot_model import RobotModel
from services.retarget.whole_body import WholeBodyRetargeter


@dataclass(frozen=True)
class Run:
    """One robot along one recording, tick by tick.

    Args:
        model: The robot.
        q: (ticks, n) commanded joint positions [rad, m].
        error_m: (ticks,) distance of the commanded hand from its reference.
        error_rad: (ticks,) the same for its orientation.
        scaling: (ticks, levels) share of hand, head where there is one, and posture achieved.
        held_back: (ticks,) whether a joint stood at a bound, or a wall or a link was in the way.
        times_s: (ticks,) how long each tick took.
        failures: Levels that had no solution, in all ticks together.
    """

    model: RobotModel
    q: Array
    error_m: Array
    error_rad: Array
    scaling: Array
    held_back: Mask
    times_s: Array
    failures: int


def follow_recording(
    model: RobotModel, recording: Recording, obstacles: Sequence[Obstacle], *, rest_ticks: int
) -> Run:
    """Give one set-point every ten ticks and note what the robot is told.

    Every command is taken to be carried out exactly.

    Args:
        model: The robot.
        recording: What its hand is to do, from the robot's start posture.
        obstacles: Fixed boxes that its links keep away from.
        rest_ticks: How long it goes on after the last set-point.
    """
    gains = model.spec.retarget
    retargeter = WholeBodyRetargeter(model, obstacles)
    lead = Lead(gains.setpoint_lead_m, gains.setpoint_lead_rad, lambda: retargeter.T_world_hand)
    reference = GripperReference(retargeter.T_world_hand, lead=lead)
    motions, errors, times_s = [], [], []
    actions = recording.list_actions()
    for tick in range(len(actions) * FRAME_TICKS + rest_ticks):
        frame, since = divmod(tick, FRAME_TICKS)
        if since == 0 and frame < len(actions):
            reference.take([actions[frame]])
        wanted = reference.advance()
        started = time.perf_counter()
        motions.append(retargeter.follow(wanted))
        times_s.append(time.perf_counter() - started)
        errors.append(distance(wanted.T_world_end, retargeter.T_world_hand))
    error_m, error_rad = np.array(errors).T
    return Run(
        model=model,
        q=np.array([motion.positions for motion in motions]),
        error_m=error_m,
        error_rad=error_rad,
        scaling=np.array([motion.scaling for motion in motions]),
        held_back=np.array([bool(motion.active_limits) for motion in motions]),
        times_s=np.array(times_s),
        failures=sum(motion.failures for motion in motions),
    )
