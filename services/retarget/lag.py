"""A tracking lag on purpose: what a policy meets on a robot that follows late."""

from __future__ import annotations

import math

import numpy as np

from common.clock import TICK_S
from common.se3 import Array, exp3, log3
from services.retarget.reference import TickReference


class TrackingLag:
    """First-order lag of the hand behind its reference.

        p+ = p + s (p_ref - p),   R+ = exp3(s log3(R_ref R^T)) R,   s = 1 - exp(-dt / lag)

    so that after `lag` seconds 63 % of a step are done, and a motion of constant speed is followed
    `lag` seconds late.

    Args:
        T_world_start: (4, 4) where the hand rests at first.
        lag_s: Its time constant; 0 passes the reference on.
    """

    def __init__(self, T_world_start: Array, *, lag_s: float) -> None:
        self._share = 1.0 if lag_s == 0.0 else 1.0 - math.exp(-TICK_S / lag_s)
        self._T_world_now = T_world_start.copy()

    def rest_at(self, T_world_hand: Array) -> None:
        """Let the hand be at a pose (4, 4) now."""
        self._T_world_now = T_world_hand.copy()

    def follow(self, reference: TickReference) -> TickReference:
        """The reference of one tick as the hand is allowed to follow it."""
        if self._share == 1.0:
            return reference
        T_start, T_wanted = self._T_world_now, reference.T_world_end
        d = self._share * (T_wanted[:3, 3] - T_start[:3, 3])
        w = self._share * log3(T_wanted[:3, :3] @ T_start[:3, :3].T)
        T_end = T_start.copy()
        T_end[:3, 3] += d
        T_end[:3, :3] = exp3(w) @ T_start[:3, :3]
        self._T_world_now = T_end
        return TickReference(T_start, T_end, np.concatenate([d, w]) / TICK_S)
