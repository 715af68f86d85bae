"""The hand task: from a pose error to the wanted twist of the hand."""

from __future__ import annotations

import math
from collections.abc import Sequence

from common.braking import stopping_speed
from common.robots.spec import RetargetSpec
from common.se3 import Array, log_quat, quat_from_matrix


def compute_hand_twist(
    T_world_hand: Array, T_world_wanted: Array, feedforward: Array, gains: RetargetSpec, dt_s: float
) -> Array:
    """Wanted hand twist x1 = shaped(e) + feed-forward, in world axes.

    e_p = p_wanted - p, e_R = log3(R_wanted R^T). Each of the two keeps its direction and gets the
    speed min(K |e|, vcap, vstop(|e|, Acap)), so that it can be braked without overshoot.

    Args:
        T_world_hand: (4, 4) where the hand is commanded to be at the start of the tick.
        T_world_wanted: (4, 4) where it should be at the start of the tick. The end of the tick
            would count the feed-forward twice.
        feedforward: (6,) twist of the reference over the tick [m/s, rad/s].
        gains: K, caps and accelerations.
        dt_s: Length of a tick.

    Returns:
        (6,) linear [m/s] and angular [rad/s] velocity.
    """
    e_p = (T_world_wanted[:3, 3] - T_world_hand[:3, 3]).tolist()
    e_R = log_quat(quat_from_matrix(T_world_wanted[:3, :3].dot(T_world_hand[:3, :3].T)))
    K = gains.hand_gain_per_s
    scale_p = _scale(e_p, K, gains.hand_speed_cap_m_s, gains.hand_acceleration_m_s2, dt_s)
    scale_R = _scale(e_R, K, gains.hand_turn_cap_rad_s, gains.hand_acceleration_rad_s2, dt_s)
    shaped = [scale_p * e for e in e_p] + [scale_R * e for e in e_R]
    return feedforward + shaped


def _scale(
    error: Sequence[float], gain: float, cap: float, acceleration: float, dt_s: float
) -> float:
    size = math.hypot(*error)
    if size == 0.0:
        return 0.0
    return min(gain * size, cap, stopping_speed(size, acceleration, dt_s)) / size
