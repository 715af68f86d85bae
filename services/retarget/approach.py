"""How fast something may be approached, given how far away it is."""

from __future__ import annotations

from dataclasses import dataclass

from common.braking import braking_distance, stopping_speed

_RETURN_CAP_M_S = 0.2


@dataclass(frozen=True)
class ApproachLimit:
    """v <= min(vstop(D, A_c), xi D) with D = d - margin: brakes, and comes to rest softly.

    Within the margin (D < 0) it asks to leave: v <= -min(0.2 m/s, xi |D|).

    Args:
        gain_per_s: xi.
        acceleration_m_s2: A_c.
        margin_m: Distance that is kept.
        dt_s: Length of a tick.
    """

    gain_per_s: float
    acceleration_m_s2: float
    margin_m: float
    dt_s: float

    def speed(self, distance_m: float) -> float:
        """Largest speed of approach [m/s]; negative: at least that speed apart."""
        D = distance_m - self.margin_m
        if D < 0.0:
            return -min(_RETURN_CAP_M_S, -self.gain_per_s * D)
        return min(self.gain_per_s * D, stopping_speed(D, self.acceleration_m_s2, self.dt_s))

    def distance(self, speed_m_s: float) -> float:
        """Distance [m] from which on this speed (>= 0) is allowed, the inverse of `speed`."""
        braking = braking_distance(speed_m_s, self.acceleration_m_s2, self.dt_s)
        return self.margin_m + max(speed_m_s / self.gain_per_s, braking)
