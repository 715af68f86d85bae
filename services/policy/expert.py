"""A scripted demonstrator: follows a task's script with human-like pace and paths."""

from __future__ import annotations

import numpy as np

from common.clock import FRAME_TICKS, TICK_S
from common.messages import ActionStep, GroundTruth
from common.se3 import Array, apply_differential, differential, distance, pose_from_wire
from common.tasks import load_task
from common.tasks.task import DemonstratorView, Script, Waypoint
from services.policy.min_jerk import MinJerkSegment
from services.policy.policy import Observation

_PERIOD_S = FRAME_TICKS * TICK_S
_BOW_FROM_M = 0.10
"""Shorter ways are too deliberate to be bent."""


class ExpertPolicy:
    """Turns a script's waypoints into 10 Hz differential poses.

    It speaks the policies' language: its set-point starts at the measured tool pose and is moved
    by its own actions only, exactly as the retargeter integrates them.
    """

    needs_truth = True
    astray_m, astray_rad = 0.02, 0.1
    """A gripper that follows as it should is nearer than this whenever a way begins."""
    evenness = 0.0
    """Of its ways, see `MinJerkSegment`."""

    def __init__(self) -> None:
        self._script: Script | None = None
        self._random = np.random.default_rng(0)
        self._pace = 1.0
        self._T_world_setpoint: Array | None = None
        self._segment: MinJerkSegment | None = None
        self._step = 0
        self._wait_steps = 0
        self._grasp = False

    def reset(self, *, seed: int, task: str) -> None:
        """Draw this demonstrator's habits: pace, path, grasp."""
        # Stream 1: the world draws from stream 0 of the same seed.
        self._random = np.random.default_rng([seed, 1])
        self._pace = float(self._random.uniform(0.85, 1.1))
        self._script = load_task(task).script(self._random)
        self._T_world_setpoint = None
        self._segment = None
        self._step = 0
        self._wait_steps = 0
        self._grasp = False

    def act(self, observation: Observation) -> list[ActionStep]:
        """One step along the current waypoint; the next waypoint when it is done."""
        if self._script is None or observation.truth is None:
            raise RuntimeError("the expert needs reset() and ground truth before act()")
        if self._T_world_setpoint is None:
            self._T_world_setpoint = pose_from_wire(observation.truth.T_world_tool)
        if self._segment is None and self._wait_steps == 0:
            self._look(pose_from_wire(observation.truth.T_world_tool))
            self._begin(self._script.next_waypoint(_view(observation.truth)))
        T_next = self._T_world_setpoint
        if self._segment is not None:
            self._step += 1
            T_next = self._follow(self._segment, self._T_world_setpoint)
        elif self._wait_steps > 0:
            self._wait_steps -= 1
        step = self._execute(*differential(self._T_world_setpoint, T_next))
        # Keep what the retargeter will integrate, not what was meant: errors must not add up.
        self._T_world_setpoint = apply_differential(
            self._T_world_setpoint, step.translation_m, step.rotation_rad
        )
        if self._segment is not None and self._arrived(self._segment, self._T_world_setpoint):
            self._segment = None
        return [step]

    def _follow(self, segment: MinJerkSegment, T_world_setpoint: Array) -> Array:
        """Where the set-point is to be after this step."""
        del T_world_setpoint
        return segment.pose(self._step)

    def _arrived(self, segment: MinJerkSegment, T_world_setpoint: Array) -> bool:
        """Whether the way has been gone."""
        del T_world_setpoint
        return self._step >= segment.steps

    def _execute(self, translation_m: Array, rotation_rad: Array) -> ActionStep:
        """The step that is made where this one is meant."""
        return ActionStep(
            translation_m=translation_m.tolist(),
            rotation_rad=rotation_rad.tolist(),
            grasp=self._grasp,
        )

    def _look(self, T_world_tool: Array) -> None:
        """Go on from where the gripper is when that is not where it was sent.

        A robot that is at the end of its reach stays behind, and its set-point with it.
        """
        if self._T_world_setpoint is None:
            return
        behind_m, behind_rad = distance(self._T_world_setpoint, T_world_tool)
        if behind_m > self.astray_m or behind_rad > self.astray_rad:
            self._T_world_setpoint = T_world_tool

    def _begin(self, waypoint: Waypoint | None) -> None:
        """Set off to a waypoint, or stay when the script has ended."""
        if waypoint is None or self._T_world_setpoint is None:
            return
        self._grasp = waypoint.grasp
        self._wait_steps = round(self._pause_s(waypoint) / _PERIOD_S)
        if waypoint.T_world_tool is None:
            return
        self._step = 0
        self._segment = MinJerkSegment(
            self._T_world_setpoint,
            waypoint.T_world_tool,
            speed_m_s=self._pace * waypoint.speed_m_s,
            turn_rad_s=self._pace * waypoint.turn_rad_s,
            period_s=_PERIOD_S,
            bow_m=self._draw_bow(waypoint.T_world_tool),
            evenness=self.evenness,
        )

    def _pause_s(self, waypoint: Waypoint) -> float:
        """How long to stay where a way has ended."""
        return waypoint.wait_s + waypoint.look_s

    def _draw_bow(self, T_world_goal: Array) -> Array:
        """A small sideways bend for long ways; always drawn, so that habits stay aligned."""
        bow = self._random.normal(0.0, 0.006, size=3)
        if self._T_world_setpoint is None:
            return np.zeros(3)
        way = T_world_goal[:3, 3] - self._T_world_setpoint[:3, 3]
        length = float(np.sqrt(way @ way))
        if length < _BOW_FROM_M:
            return np.zeros(3)
        direction = way / length
        return bow - direction * float(direction @ bow)


def _view(truth: GroundTruth) -> DemonstratorView:
    return DemonstratorView(
        T_world_tool=pose_from_wire(truth.T_world_tool),
        objects={name: pose_from_wire(wire) for name, wire in truth.objects.items()},
        opening_m=truth.opening_m,
    )
