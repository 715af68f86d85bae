"""The motion law of everything that a guard decides itself, and the check of what it is told."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from common.braking import stopping_speed
from common.errors import InvalidValue, WrongShape
from common.safety.limits import RobotLimits
from common.safety.space import JointSpace, PoseSpace, Space

_SLACK = 1e-6
"""Share of a limit, and rad or m of a range, that rounding may exceed."""
_MISMATCH = 1e-6
"""How far a position may be from where its velocity leads within a tick [rad, m]."""


class Setpoint(NamedTuple):
    """Where to be at the end of a tick and how fast, in the form of `RobotCommand`."""

    positions: list[float]
    velocities: list[float]


@dataclass(frozen=True)
class Violation:
    """Which limits a command would break."""

    position: bool
    velocity: bool
    acceleration: bool


class MotionLaw:
    """Takes a set-point from tick to tick within a robot's limits.

    A wanted velocity w becomes, per degree of freedom,

        up = min(vmax, vstop(qmax - q)),   lo = -min(vmax, vstop(q - qmin)),
        v+ = clip(clip(w, lo, up), v - A dt, v + A dt),   q+ = q + v+ dt

    with `vstop` of `common.braking`: whoever keeps to it can brake before the end of its range.
    Where v+ only slows down, A is that of a stop.

    Args:
        limits: Of the robot.
        dt_s: Length of a tick.
    """

    def __init__(self, limits: RobotLimits, *, dt_s: float) -> None:
        self._space: Space = PoseSpace() if limits.free_hand else JointSpace()
        self._axes = limits.axes
        self._dt_s = dt_s
        self._nv = len(limits.axes)
        self._nq = 7 if limits.free_hand else self._nv
        share = 1.0 + _SLACK
        # Range, A dt / 2 and 2 A: v <= vstop(d) is certain when (v + A dt / 2)^2 <= 2 A d.
        self._ranges = [
            (axis.lower, axis.upper, 0.5 * axis.acceleration * dt_s, 2.0 * axis.acceleration)
            for axis in (() if limits.free_hand else limits.axes)
        ]
        # Largest speed, largest change of it, and the largest of braking, with the slack.
        self._widths = [
            tuple(
                share * most
                for most in (axis.velocity, axis.acceleration * dt_s, axis.stop_acceleration * dt_s)
            )
            for axis in limits.axes
        ]

    def check(self, wanted: Setpoint) -> None:
        """Refuse what is no set-point of this robot.

        Raises:
            WrongShape: Not one number per degree of freedom.
            InvalidValue: Not a pose where one is expected, or not finite.
        """
        for what, expected, values in (
            ("positions", self._nq, wanted.positions),
            ("velocities", self._nv, wanted.velocities),
        ):
            if len(values) != expected:
                raise WrongShape(what, expected, len(values))
            if not all(map(math.isfinite, values)):
                raise InvalidValue(what, values, "finite numbers")
        self._space.check(wanted.positions)

    def admits(self, now: Setpoint, wanted: Setpoint) -> bool:
        """Whether a set-point breaks no limit and its velocity leads to its position."""
        for i, (lower, upper, half, twice) in enumerate(self._ranges):
            q = wanted.positions[i]
            above, below = upper - q, q - lower
            speed = abs(wanted.velocities[i]) + half
            if speed * speed > twice * (above if above < below else below) and not self._can_stop(
                i, now, wanted
            ):
                return False
        step = self._space.subtract(wanted.positions, now.positions)
        dt_s = self._dt_s
        for d, v, v_now, (fastest, change, braking) in zip(
            step, wanted.velocities, now.velocities, self._widths, strict=True
        ):
            if not (
                -fastest <= v <= fastest
                and (-change <= v - v_now <= change or _brakes(v_now, v, braking))
                and -_MISMATCH <= d - dt_s * v <= _MISMATCH
            ):
                return False
        return True

    def find_violation(self, now: Setpoint, wanted: Setpoint) -> Violation:
        """Which limits the positions of a set-point break, whatever velocity it claims."""
        step = self._space.subtract(wanted.positions, now.positions)
        speeds = [d / self._dt_s for d in step]
        fastest = [most for most, _, _ in self._widths]
        return Violation(
            position=not all(self._can_stop(i, now, wanted) for i in range(len(self._ranges))),
            velocity=any(
                max(abs(v), abs(claimed)) > most
                for v, claimed, most in zip(speeds, wanted.velocities, fastest, strict=True)
            ),
            acceleration=any(
                abs(v - v_now) > change and not _brakes(v_now, v, braking)
                for v, v_now, (_, change, braking) in zip(
                    speeds, now.velocities, self._widths, strict=True
                )
            ),
        )

    def approach(self, now: Setpoint, wanted: Setpoint) -> Setpoint:
        """As near to a set-point as the limits allow, without running past it.

        With e = (q_wanted - q) - v_wanted dt, the velocity v_wanted + sign(e) vstop(|e|) catches up
        with a moving command and brakes in time to meet it.
        """
        dt_s = self._dt_s
        step = self._space.subtract(wanted.positions, now.positions)
        w = [
            v
            + math.copysign(
                stopping_speed(abs(d - dt_s * v), axis.acceleration, dt_s), d - dt_s * v
            )
            for d, v, axis in zip(step, wanted.velocities, self._axes, strict=True)
        ]
        return self.advance(now, w)

    def brake(self, now: Setpoint) -> Setpoint:
        """One tick of braking, as hard as a stop may be."""
        return self.advance(now, [0.0] * self._nv)

    def advance(self, now: Setpoint, w: list[float]) -> Setpoint:
        """One tick at a wanted velocity, within all limits."""
        velocities = list[float]()
        for i, (wanted, axis) in enumerate(zip(w, self._axes, strict=True)):
            low, up = self._find_window(i, now.positions[i], axis.acceleration)
            v_now = now.velocities[i]
            change = axis.acceleration * self._dt_s
            braking = axis.stop_acceleration * self._dt_s
            least = min(v_now - change, max(0.0, v_now - braking))
            most = max(v_now + change, min(0.0, v_now + braking))
            velocities.append(min(max(min(max(wanted, low), up), least), most))
        step = [self._dt_s * v for v in velocities]
        return Setpoint(self._space.add(now.positions, step), velocities)

    def _can_stop(self, i: int, now: Setpoint, wanted: Setpoint) -> bool:
        """Whether a position is within its range, and was not approached too fast to stop there."""
        axis, q, v = self._axes[i], wanted.positions[i], wanted.velocities[i]
        low, up = self._find_window(i, now.positions[i], axis.acceleration)
        share = 1.0 + _SLACK
        inside = axis.lower - _SLACK <= q <= axis.upper + _SLACK
        return inside and share * low - _SLACK <= v <= share * up + _SLACK

    def _find_window(self, i: int, q: float, A: float) -> tuple[float, float]:
        """Slowest and fastest velocity of an axis from which it can brake within its range."""
        axis = self._axes[i]
        if math.isinf(axis.upper) and math.isinf(axis.lower):
            return -axis.velocity, axis.velocity
        room_above, room_below = max(0.0, axis.upper - q), max(0.0, q - axis.lower)
        return (
            -min(axis.velocity, stopping_speed(room_below, A, self._dt_s)),
            min(axis.velocity, stopping_speed(room_above, A, self._dt_s)),
        )


def _brakes(v_now: float, v: float, most: float) -> bool:
    """Whether a change of velocity only slows down, by no more than a stop may."""
    return v * v_now >= 0.0 and abs(v) <= abs(v_now) and abs(v - v_now) <= most
