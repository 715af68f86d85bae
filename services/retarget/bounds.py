"""Velocity bounds of the joints: position, velocity and acceleration limits in one box."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from common.se3 import Array
from services.retarget.braking import braking_distance, stopping_speed

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
    """

    lower: float
    upper: float
    velocity: float
    acceleration: float


@dataclass(frozen=True)
class Box:
    """Bounds l <= a <= u of joint velocities [rad/s, m/s], l <= u."""

    lower: list[float]
    upper: list[float]

    def contains(self, a: Array) -> bool:
        """Whether all velocities (n,) are within."""
        return all(
            least <= value <= most
            for value, least, most in zip(a.tolist(), self.lower, self.upper, strict=True)
        )

    def clip(self, a: Array) -> Array:
        """The velocities (n,) of the box nearest to given ones."""
        return np.array(
            [
                min(max(value, least), most)
                for value, least, most in zip(a.tolist(), self.lower, self.upper, strict=True)
            ]
        )

    def cut_line(self, a: Array, direction: Array) -> tuple[float, float] | None:
        """All z for which a + z direction is within: an interval, or None when there are none."""
        first, last = -math.inf, math.inf
        for value, slope, least, most in zip(
            a.tolist(), direction.tolist(), self.lower, self.upper, strict=True
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

    Args:
        limits: One per joint.
        dt_s: Length of a tick.
    """

    def __init__(self, limits: Sequence[JointLimits], *, dt_s: float) -> None:
        self._dt_s = dt_s
        # Further away than this, a limit does not slow the joint down.
        self._joints = [
            (
                limit,
                limit.acceleration * dt_s,
                braking_distance(limit.velocity, limit.acceleration, dt_s),
            )
            for limit in limits
        ]

    def compute(self, q: Sequence[float], a_prev: Sequence[float]) -> Box:
        """Bounds for the coming tick.

        Args:
            q: (n,) commanded positions [rad, m].
            a_prev: (n,) velocities of the last tick [rad/s, m/s].
        """
        lower: list[float] = []
        upper: list[float] = []
        for (limit, change, far), position, last in zip(self._joints, q, a_prev, strict=True):
            lo, up = -limit.velocity, limit.velocity
            if limit.upper - position < far or position - limit.lower < far:
                lo, up = self._near_a_limit(limit, position)
            least, most = last - change, last + change
            lower.append(min(max(lo, least), most))
            upper.append(min(max(up, least), most))
        return Box(lower, upper)

    def _near_a_limit(self, limit: JointLimits, position: float) -> tuple[float, float]:
        """`lo` and `up` of one joint before the acceleration limit."""
        above, below = limit.upper - position, position - limit.lower
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
