"""A lag on purpose: 63 % of a step after its time constant, and nothing at all when it is zero."""

import math

import numpy as np

from common.clock import TICK_S
from common.se3 import Array, distance, exp3, make_pose
from services.retarget.lag import TrackingLag
from services.retarget.reference import TickReference

LAG_S = 0.08
START = make_pose(exp3([0.1, -0.2, 0.3]), [0.1, -0.3, 0.8])


def resting_at(T: Array) -> TickReference:
    return TickReference(T, T, np.zeros(6))


def test_no_lag_changes_nothing():
    reference = resting_at(START)
    assert TrackingLag(START, lag_s=0.0).follow(reference) is reference


def test_a_step_is_done_to_63_percent_after_the_time_constant():
    goal = make_pose(exp3([0.0, 0.0, 0.5]) @ START[:3, :3], START[:3, 3] + [0.1, 0.0, 0.0])
    lag = TrackingLag(START, lag_s=LAG_S)
    for _ in range(round(LAG_S / TICK_S)):
        followed = lag.follow(resting_at(goal))
    left_m, left_rad = distance(followed.T_world_end, goal)
    assert abs(left_m - 0.1 * math.exp(-1.0)) < 1e-12
    assert abs(left_rad - 0.5 * math.exp(-1.0)) < 1e-12


def test_constant_speed_is_followed_late_by_the_time_constant():
    lag, speed_m_s = TrackingLag(START, lag_s=LAG_S), 0.2
    T = START
    for _ in range(200):
        T_next = T.copy()
        T_next[0, 3] += speed_m_s * TICK_S
        followed = lag.follow(TickReference(T, T_next, np.array([speed_m_s, 0, 0, 0, 0, 0.0])))
        T = T_next
    behind_s = (T[0, 3] - followed.T_world_end[0, 3]) / speed_m_s
    # In discrete time, to within a tick.
    assert LAG_S - TICK_S <= behind_s <= LAG_S
    assert np.allclose(followed.twist, [speed_m_s, 0, 0, 0, 0, 0], atol=1e-9)


def test_each_tick_starts_where_the_last_one_ended():
    goal = make_pose(START[:3, :3], START[:3, 3] + [0.0, 0.05, 0.0])
    lag = TrackingLag(START, lag_s=LAG_S)
    first, second = lag.follow(resting_at(goal)), lag.follow(resting_at(goal))
    assert np.array_equal(first.T_world_start, START)
    assert np.array_equal(second.T_world_start, first.T_world_end)
