"""Smooth motion between two poses, as a hand makes it."""

from __future__ import annotations

import math

import numpy as np

from common.se3 import Array, distance, exp3, log3, make_pose

_PEAK = 1.875
"""Peak over mean speed of a minimum-jerk motion."""


def min_jerk(tau: float) -> float:
    """Progress s = 10 tau^3 - 15 tau^4 + 6 tau^5 with zero speed and acceleration at both ends.

    Args:
        tau: Share of the duration, in [0, 1].
    """
    return tau**3 * (10.0 - 15.0 * tau + 6.0 * tau * tau)


class MinJerkSegment:
    """Motion from one tool pose to another in whole 10 Hz steps.

    p = p0 + s (p1 - p0) + b 16 s^2 (1-s)^2, R = R0 exp(s log(R0^T R1)); the bow b bends the path
    sideways without touching its ends. s = (1 - e) min_jerk(tau) + e tau: with an evenness e above
    zero the hand comes and goes at e times its mean speed, and stops nowhere.

    Args:
        T_start: (4, 4) first pose.
        T_end: (4, 4) last pose.
        speed_m_s: Largest speed.
        turn_rad_s: Largest turning speed.
        period_s: Time between two steps.
        bow_m: (3,) sideways displacement at half way.
        evenness: e, in [0, 1].
    """

    def __init__(
        self,
        T_start: Array,
        T_end: Array,
        *,
        speed_m_s: float,
        turn_rad_s: float,
        period_s: float,
        bow_m: Array | None = None,
        evenness: float = 0.0,
    ) -> None:
        self._T_start = T_start.copy()
        self._T_end = T_end.copy()
        self._bow = np.zeros(3) if bow_m is None else bow_m
        self._turn = log3(T_start[:3, :3].T @ T_end[:3, :3])
        way_m, angle_rad = distance(T_start, T_end)
        self._evenness = evenness
        peak = _PEAK + evenness * (1.0 - _PEAK)
        duration_s = peak * max(way_m / speed_m_s, angle_rad / turn_rad_s)
        self.steps = max(1, math.ceil(duration_s / period_s))

    def pose(self, step: int) -> Array:
        """(4, 4) pose after a number of steps; the end pose from `steps` on."""
        if step >= self.steps:
            return self._T_end.copy()
        tau = step / self.steps
        smooth = min_jerk(tau)
        s = smooth + self._evenness * (tau - smooth)
        p = self._T_start[:3, 3] + s * (self._T_end[:3, 3] - self._T_start[:3, 3])
        p = p + 16.0 * (s * (1.0 - s)) ** 2 * self._bow
        return make_pose(self._T_start[:3, :3] @ exp3(s * self._turn), p)
