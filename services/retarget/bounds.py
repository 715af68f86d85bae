"""Velocity bounds of the joints: position, velocity and acceleration limits in one box."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from common.braking import braking_distance, stopping_speed
from common.errors import InvalidValue
from common.se3 import Array
from services.retarget.level import Mask

RETURN_GAIN_PER_S = 5.0
"""A joint outside its range is led back at this gain."""

_NO_SLOPE = 1e-12


@dataclass(frozen=True)
class JointLimits:
    """Limits of one joint; the range may be infinite.

    Args:
        lower: qmin [rad, m].
        upper: qmax [rad, m].
        velocity: vmax [rad/s, m/s].
        acceleration: A [rad/s2, m/s2].
        lead: How far the command may run ahead of the measurement [rad, m].
    """

    lower: float
    upper: float
    velocity: float
    acceleration: float
    lead: float = math.inf


class Box(NamedTuple):
    """Bounds l <= a <= u of joint velocities, each (n,) [rad/s, m/s], l <= u."""

    lower: Array
    upper: Array

    def contains(self, a: Array) -> bool:
        """Whether all velocities (n,) are within."""
        return np.count_nonzero((a < self.lower) | (a > self.upper)) == 0

    def clip(self, a: Array) -> Array:
        """The velocities (n,) of the box nearest to given ones."""
        return np.minimum(np.maximum(a, self.lower), self.upper)

    def cut_line(self, a: Array, direction: Array) -> tuple[float, float] | None:
        """All z for which a + z direction is within: an interval, or None when there are none."""
        first, last = -math.inf, math.inf
        for value, slope, least, most in zip(
            a.tolist(), direction.tolist(), self.lower.tolist(), self.upper.tolist(), strict=True
        ):
            if slope > _NO_SLOPE:
                enter, leave = (least - value) / slope, (most - value) / slope
            elif slope < -_NO_SLOPE:
                enter, leave = (most - value) / slope, (least - value) / slope
            elif least <= value <= most:
                continue
            else:
                return None
            first, last = max(first, enter), min(last, leave)
        return (first, last) if first <= last else None


class JointBounds:
    """The box of one tick, never empty.

        up =  min(vmax, vstop(qmax - q)),   lo = -min(vmax, vstop(q - qmin))
        u = clip(up, a_prev - A dt, a_prev + A dt),   l the same of lo

    Once inside, the clip never overrides the position bound, so that the sequence q + a dt stays
    inside exactly. A joint outside (over > 0) is pushed back: up = max(lo, -min(vmax, g over)) with
    g = 5/s, mirrored for lo. As lo <= up and clip is monotone, l <= u always.

    The command may not run away from the measured position either: with b = lead + D(vmax) the
    same two formulas for the range [measured - b, measured + b] give a second pair, which is
    clipped to the first. It brakes the command of a joint that is further behind than its lead.

    Args:
        limits: One per joint.
        dt_s: Length of a tick.

    Raises:
        InvalidValue: dt_s is not positive.
    """

    def __init__(self, limits: Sequence[JointLimits], *, dt_s: float) -> None:
        if not dt_s > 0.0:
            raise InvalidValue("dt_s", dt_s, "a time longer than zero")
        self._dt_s = dt_s
        self._limits = tuple(limits)
        self._n = len(self._limits)
        # Both sides of every joint in one vector: upper ones as they are, lower ones negated.
        self._vmax = np.array([limit.velocity for limit in limits] * 2)
        self._change = np.array([limit.acceleration for limit in limits] * 2) * dt_s
        # Further away than this, a limit does not slow the joint down.
        self._far = np.array(
            [braking_distance(limit.velocity, limit.acceleration, dt_s) for limit in limits]
        )
        upper = np.array([limit.upper for limit in limits]) - self._far
        lower = np.array([limit.lower for limit in limits]) + self._far
        self._slow_above, self._slow_below = upper, lower
        self._lead = np.array([limit.lead for limit in limits])

    def compute(self, q: Array, a_prev: Array, measured: Array | None = None) -> Box:
        """Bounds for the coming tick.

        Args:
            q: (n,) commanded positions [rad, m].
            a_prev: (n,) velocities of the last tick [rad/s, m/s].
            measured: (n,) where the joints are; without it there is no leash.
        """
        n, most = self._n, self._vmax
        near = (q > self._slow_above) | (q < self._slow_below)
        lead = None if measured is None else q - measured
        # Counting is several times faster than `any`.
        if np.count_nonzero(near) or (
            lead is not None and np.count_nonzero(np.abs(lead) > self._lead)
        ):
            most = self._near_a_limit(q, near, lead)
        last = np.concatenate([a_prev, -a_prev])
        sides = np.minimum(np.maximum(most, last - self._change), last + self._change)
        return Box(-sides[n:], sides[:n])

    def _near_a_limit(self, q: Array, near: Mask, lead: Array | None) -> Array:
        """(2n,) `up` and negated `lo` before the acceleration limit."""
        n = self._n
        most = self._vmax.copy()
        for i in near.nonzero()[0].tolist():
            limit, position = self._limits[i], float(q[i])
            lo, up = self._near(limit, limit.upper - position, position - limit.lower)
            most[i], most[n + i] = up, -lo
        if lead is not None:
            for i in (np.abs(lead) > self._lead).nonzero()[0].tolist():
                limit, ahead = self._limits[i], float(lead[i])
                leash = limit.lead + float(self._far[i])
                lo, up = self._near(limit, leash - ahead, ahead + leash)
                least = -most[n + i]
                most[i], most[n + i] = max(min(up, most[i]), least), -min(max(lo, least), most[i])
        return most

    def _near(self, limit: JointLimits, above: float, below: float) -> tuple[float, float]:
        """`lo` and `up` of one joint before the acceleration limit, by its distances to a range."""
        up = self._slowed(limit, max(above, 0.0))
        lo = -self._slowed(limit, max(below, 0.0))
        if above < 0.0:
            up = max(lo, -min(limit.velocity, -RETURN_GAIN_PER_S * above))
        elif below < 0.0:
            lo = min(up, min(limit.velocity, -RETURN_GAIN_PER_S * below))
        return lo, up

    def _slowed(self, limit: JointLimits, distance: float) -> float:
        if math.isinf(distance):
            return limit.velocity
        return min(limit.velocity, stopping_speed(distance, limit.acceleration, self._dt_s))
