"""How fast one may move and still stop in time, exactly in discrete time."""

from __future__ import annotations

import math


def braking_distance(speed: float, acceleration: float, dt_s: float) -> float:
    """Distance covered from a speed to rest, braking fully, in ticks.

    D(v) = dt (v + (v - A dt) + (v - 2 A dt) + ...) over the terms that are positive.

    Args:
        speed: v >= 0 [m/s, rad/s].
        acceleration: A > 0 [m/s2, rad/s2].
        dt_s: Length of a tick.

    Returns:
        Distance [m, rad].
    """
    m = math.floor(speed / (acceleration * dt_s))
    return dt_s * (m + 1) * (speed - 0.5 * m * acceleration * dt_s)


def stopping_speed(distance: float, acceleration: float, dt_s: float) -> float:
    """Largest speed that can still stop within a distance: the inverse of `braking_distance`.

    With x = d / (A dt^2):

        m = floor((sqrt(1 + 8 x) - 1) / 2),   vstop(d) = A dt (m / 2 + x / (m + 1))

    It never exceeds d / dt, while the continuous sqrt(2 A d) is up to A dt / 2 too fast.

    Args:
        distance: d >= 0 [m, rad].
        acceleration: A > 0 [m/s2, rad/s2].
        dt_s: Length of a tick.

    Returns:
        Speed [m/s, rad/s].
    """
    x = distance / (acceleration * dt_s * dt_s)
    m = math.floor(0.5 * (math.sqrt(1.0 + 8.0 * x) - 1.0))
    return acceleration * dt_s * (0.5 * m + x / (m + 1.0))
