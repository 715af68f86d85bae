"""The scripted demonstrator, pushed off its path now and then (after DART, Laskey et al. 2017).

A policy that has seen perfect demonstrations only does not know the way back from its own small
errors. This demonstrator executes disturbed steps and says with each which step it meant; the
recorder stores both.
"""

from __future__ import annotations

import numpy as np

from common.messages import ActionStep, Motion
from common.se3 import Array, apply_differential, differential, distance
from common.tasks.task import Waypoint
from services.policy.disturbance import Disturbance
from services.policy.expert import ExpertPolicy
from services.policy.min_jerk import MinJerkSegment

_STREAM = 5
"""Worlds, experts, sensors and variations draw from other streams of a trial's seed."""
_KEPT = 0.65
"""Share of the way off the path that is left after a step: a hand goes back smoothly."""
_ARRIVED_M, _ARRIVED_RAD = 0.003, 0.02
"""Where it stays."""
_PASSED_M, _PASSED_RAD = 0.010, 0.06
"""Where it only passes."""
_LONGEST_SETTLING_STEPS = 12
_CARE = 0.6
"""A hand that is about to act calms down: what is left of the pushes after each further step."""


class NoisyExpertPolicy(ExpertPolicy):
    """Follows the script; meets its waypoints in spite of pushes, and stops only where it must.

    A policy that sees where it is, not since when, cannot leave a place where its demonstrator
    stood still for no visible reason. So this one neither looks around nor slows down on its way,
    and stays only where the script waits for the fingers or for what is held.

    The set-point is off the path by D = P_k^-1 S_k. Meant is P_{k+1} Exp(0.65 Log D), executed is
    that with a push.
    """

    evenness = 0.4
    astray_m, astray_rad = 0.08, 0.4
    """A hand that lags behind is that far off while it moves."""

    def __init__(self) -> None:
        super().__init__()
        self._stays = False
        self.disturbance = Disturbance(np.random.default_rng(0))
        self._T_world_path: Array = np.eye(4)

    def reset(self, *, seed: int, task: str) -> None:
        """Draw the demonstrator's habits and how much it is disturbed."""
        super().reset(seed=seed, task=task)
        self.disturbance = Disturbance(np.random.default_rng([seed, _STREAM]))

    def _follow(self, segment: MinJerkSegment, T_world_setpoint: Array) -> Array:
        if self._step == 1:
            self._T_world_path = T_world_setpoint
        offset_m, offset_rad = differential(self._T_world_path, T_world_setpoint)
        self._T_world_path = segment.pose(self._step)
        return apply_differential(self._T_world_path, _KEPT * offset_m, _KEPT * offset_rad)

    def _arrived(self, segment: MinJerkSegment, T_world_setpoint: Array) -> bool:
        if self._step < segment.steps:
            return False
        off_m, off_rad = distance(segment.pose(self._step), T_world_setpoint)
        late = self._step >= segment.steps + _LONGEST_SETTLING_STEPS
        near_m, near_rad = (_ARRIVED_M, _ARRIVED_RAD) if self._stays else (_PASSED_M, _PASSED_RAD)
        return late or (off_m <= near_m and off_rad <= near_rad)

    def _pause_s(self, waypoint: Waypoint) -> float:
        self._stays = waypoint.wait_s > 0.0
        return waypoint.wait_s

    def _execute(self, translation_m: Array, rotation_rad: Array) -> ActionStep:
        meant = super()._execute(translation_m, rotation_rad)
        if self._segment is None:
            self.disturbance.rest()
            return meant
        late = max(0, self._step - self._segment.steps)
        push_m, push_rad = self.disturbance.draw(translation_m, rotation_rad, care=_CARE**late)
        T_pushed = apply_differential(
            apply_differential(np.eye(4), translation_m, rotation_rad), push_m, push_rad
        )
        executed = super()._execute(*differential(np.eye(4), T_pushed))
        return executed.model_copy(
            update={
                "meant": Motion(translation_m=meant.translation_m, rotation_rad=meant.rotation_rad)
            }
        )
