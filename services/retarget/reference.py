"""The gripper reference: a set-point that policies move at 10 Hz, interpolated at 100 Hz."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from common.clock import FRAME_TICKS, TICK_S
from common.errors import InvalidValue
from common.messages import ActionStep
from common.se3 import Array, apply_differential, distance, exp3, log3


class TickReference(NamedTuple):
    """Where the gripper should be over one tick.

    Args:
        T_world_start: (4, 4) pose at the start of the tick.
        T_world_end: (4, 4) pose at its end.
        twist: (6,) linear and angular velocity over the tick, world axes [m/s, rad/s].
    """

    T_world_start: Array
    T_world_end: Array
    twist: Array


_TAU: Array = np.arange(1, FRAME_TICKS + 1)[:, None] / FRAME_TICKS
"""(ticks, 1) shares of the way at the ends of ticks."""


@dataclass(frozen=True)
class Lead:
    """How far a set-point may be ahead of the hand.

    Args:
        lead_m: Its distance from the hand.
        lead_rad: The same for its orientation.
        locate_hand: Tells T_world_hand (4, 4), where the hand is at this moment.
    """

    lead_m: float
    lead_rad: float
    locate_hand: Callable[[], Array]

    def limit(self, T_world_wanted: Array) -> Array:
        """The pose (4, 4) towards a wanted one that is at most the lead away from the hand."""
        T_world_hand = self.locate_hand()
        error_m, error_rad = distance(T_world_hand, T_world_wanted)
        if error_m <= self.lead_m and error_rad <= self.lead_rad:
            return T_world_wanted
        T = T_world_wanted.copy()
        if error_m > self.lead_m:
            d = T[:3, 3] - T_world_hand[:3, 3]
            T[:3, 3] = T_world_hand[:3, 3] + (self.lead_m / error_m) * d
        if error_rad > self.lead_rad:
            w = log3(T[:3, :3] @ T_world_hand[:3, :3].T)
            T[:3, :3] = exp3((self.lead_rad / error_rad) * w) @ T_world_hand[:3, :3]
        return T


class Setpoint:
    """The pose that the policy's differential poses are composed on, and what is left of a chunk.

    It never runs away: a step that would take it further than the lead from the hand is cut there.

    Args:
        T_world_tool: (4, 4) where it starts: the measured tool pose.
        lead: How far it may be ahead of the hand; None: any distance.
    """

    def __init__(self, T_world_tool: Array, *, lead: Lead | None) -> None:
        self.T_world_setpoint = T_world_tool.copy()
        self._lead = lead
        self._steps: list[ActionStep] = []

    def replace(self, steps: Sequence[ActionStep]) -> None:
        """Take the steps of a new action; what was left of the last one is dropped."""
        self._steps = list(steps)

    def advance(self) -> bool:
        """Move on by the next step; tell whether there was one."""
        if not self._steps:
            return False
        step = self._steps.pop(0)
        T = apply_differential(self.T_world_setpoint, step.translation_m, step.rotation_rad)
        self.T_world_setpoint = T if self._lead is None else self._lead.limit(T)
        return True


class WaypointInterpolator:
    """Straight motion from the current reference to a waypoint in ten ticks, then rest.

    With tau from 0 to 1: p = p0 + tau (p1 - p0), R = exp3(tau w) R0, w = log3(R1 R0^T). Twist
    ((p1 - p0) / h, w / h), h = 0.1 s, is constant in world axes. One waypoint of latency is the
    price of knowing it.

    Args:
        T_world_start: (4, 4) where it rests at first.
    """

    def __init__(self, T_world_start: Array) -> None:
        self._T_now = T_world_start.copy()
        self._way: list[Array] = []
        self._twist = np.zeros(6)
        self._ticks = FRAME_TICKS

    @property
    def T_world_reference(self) -> Array:
        """Pose (4, 4) at this moment."""
        return self._T_now

    @property
    def arrived(self) -> bool:
        """Whether the last waypoint is reached."""
        return self._ticks >= FRAME_TICKS

    def aim(self, T_world_waypoint: Array) -> None:
        """Start from wherever the reference is now towards a waypoint (4, 4).

        Raises:
            InvalidValue: The waypoint is not finite.
        """
        if not np.isfinite(T_world_waypoint).all():
            raise InvalidValue("waypoint", T_world_waypoint.tolist(), "finite numbers")
        T_from = self._T_now
        w = log3(T_world_waypoint[:3, :3] @ T_from[:3, :3].T)
        d = T_world_waypoint[:3, 3] - T_from[:3, 3]
        self._way = _lay_out(T_from, d, exp3(w / FRAME_TICKS), T_world_waypoint)
        self._twist = np.concatenate([d, w]) / (FRAME_TICKS * TICK_S)
        self._ticks = 0

    def advance(self) -> TickReference:
        """Move on by one tick."""
        T_start = self._T_now
        if self.arrived:
            return TickReference(T_start, T_start, np.zeros(6))
        self._T_now = self._way[self._ticks]
        self._ticks += 1
        return TickReference(T_start, self._T_now, self._twist)


def _lay_out(T_from: Array, d: Array, R_step: Array, T_to: Array) -> list[Array]:
    """Poses (4, 4) at the ends of ten ticks, each a tenth of the turn after the one before."""
    way = np.repeat(T_from[None], FRAME_TICKS, axis=0)
    way[:, :3, 3] += _TAU * d
    turned = np.ascontiguousarray(T_from[:3, :3])
    for T in way:
        turned = R_step.dot(turned)
        T[:3, :3] = turned
    way[-1] = T_to
    return list(way)


class GripperReference:
    """Set-point and interpolator of one episode.

    Args:
        T_world_tool: (4, 4) measured tool pose at the first tick.
        lead: How far the set-point may be ahead of the hand; None: any distance.
    """

    def __init__(self, T_world_tool: Array, *, lead: Lead | None) -> None:
        self._setpoint = Setpoint(T_world_tool, lead=lead)
        self._interpolator = WaypointInterpolator(T_world_tool)

    def take(self, steps: Sequence[ActionStep]) -> None:
        """Start on a new action now, from the current reference."""
        self._setpoint.replace(steps)
        self._aim_at_next_step()

    def rest_at(self, T_world_hand: Array) -> None:
        """Stay at a pose (4, 4) until the next action; what was left of a chunk is dropped.

        The set-point stays where it is: the next action's steps are composed on it.
        """
        self._setpoint.replace(())
        self._interpolator = WaypointInterpolator(T_world_hand)

    def advance(self) -> TickReference:
        """Move on by one tick; a chunk continues whenever its last waypoint is reached."""
        if self._interpolator.arrived:
            self._aim_at_next_step()
        return self._interpolator.advance()

    def _aim_at_next_step(self) -> None:
        if self._setpoint.advance():
            self._interpolator.aim(self._setpoint.T_world_setpoint)
