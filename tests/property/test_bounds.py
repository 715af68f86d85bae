"""Braking in discrete time and the velocity box: never empty, and inside it stays."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from common.braking import braking_distance, stopping_speed
from services.retarget.bounds import Box, JointBounds, JointLimits

DT_S = 0.01

distances = st.floats(0.0, 10.0)
accelerations = st.floats(0.01, 500.0)
speeds = st.floats(0.0, 5.0)
numbers = st.floats(-20.0, 20.0)
limits = st.builds(
    lambda low, width, v, a: JointLimits(low, low + width, v, a),
    st.floats(-3.0, 3.0) | st.just(-math.inf),
    st.floats(0.0, 6.0) | st.just(math.inf),
    st.floats(1e-3, 5.0),
    st.floats(1e-2, 100.0),
).filter(lambda limit: not math.isnan(limit.upper))


def _brake(speed: float, acceleration: float) -> float:
    covered = 0.0
    while speed > 0.0:
        covered += speed * DT_S
        speed -= acceleration * DT_S
    return covered


@given(st.floats(0.0, 3.0), st.floats(0.5, 50.0))
def test_braking_distance_is_the_sum_of_the_ticks(speed, acceleration):
    assert math.isclose(
        braking_distance(speed, acceleration, DT_S), _brake(speed, acceleration), abs_tol=1e-10
    )


@given(distances, accelerations)
def test_stopping_speed_is_the_inverse_of_braking(distance, acceleration):
    v = stopping_speed(distance, acceleration, DT_S)
    assert math.isclose(
        braking_distance(v, acceleration, DT_S), distance, rel_tol=1e-9, abs_tol=1e-12
    )


@given(distances, accelerations)
def test_stopping_speed_never_passes_the_limit_in_one_tick(distance, acceleration):
    v = stopping_speed(distance, acceleration, DT_S)
    # Far below any distance, numbers have no relative accuracy.
    assert 0.0 <= v <= distance / DT_S * (1.0 + 1e-12) + 1e-300
    # The continuous formula is too fast, but by less than half a tick of braking.
    assert (
        -1e-9 <= math.sqrt(2.0 * acceleration * distance) - v <= 0.51 * acceleration * DT_S + 1e-9
    )


@given(st.lists(st.tuples(limits, numbers, numbers), min_size=1, max_size=7))
def test_the_box_is_never_empty_and_respects_acceleration(joints):
    box = JointBounds([limit for limit, _, _ in joints], dt_s=DT_S).compute(
        np.array([q for _, q, _ in joints]), np.array([a for _, _, a in joints])
    )
    for (limit, _, a_prev), low, high in zip(joints, box.lower, box.upper, strict=True):
        assert low <= high
        change = limit.acceleration * DT_S
        assert a_prev - change <= low
        assert high <= a_prev + change


@settings(max_examples=200)
@given(
    limits.filter(lambda limit: math.isfinite(limit.lower) and math.isfinite(limit.upper)),
    st.floats(0.0, 1.0),
    st.lists(st.floats(0.0, 1.0), min_size=50, max_size=150),
)
def test_whatever_is_chosen_from_the_box_stays_inside(limit, where, choices):
    bounds = JointBounds([limit], dt_s=DT_S)
    q, a = limit.lower + where * (limit.upper - limit.lower), 0.0
    for choice in choices:
        box = bounds.compute(np.array([q]), np.array([a]))
        low, high = box.lower[0], box.upper[0]
        # Extremes are where limits fail.
        chosen = low if choice < 0.3 else high if choice > 0.7 else low + choice * (high - low)
        assert abs(chosen - a) <= limit.acceleration * DT_S * (1.0 + 1e-6)
        a = min(max(chosen, low), high)
        q += DT_S * a
        assert limit.lower - 1e-12 <= q <= limit.upper + 1e-12
        assert abs(a) <= limit.velocity + 1e-9


@given(st.floats(0.01, 0.5), st.floats(-1.0, 1.0), st.booleans())
def test_a_joint_outside_returns_without_a_jump(over, a, above):
    limit = JointLimits(-1.0, 1.0, 2.0, 10.0)
    bounds = JointBounds([limit], dt_s=DT_S)
    sign = 1.0 if above else -1.0
    q = sign * (1.0 + over)
    for _ in range(300):
        box = bounds.compute(np.array([q]), np.array([a]))
        a = min(max(sign * 5.0, box.lower[0]), box.upper[0])
        q += DT_S * a
    assert sign * q <= 1.0 + 1e-4


@given(
    st.floats(0.02, 0.5),
    st.lists(st.tuples(st.floats(0.0, 1.0), st.floats(-0.05, 0.05)), min_size=100, max_size=300),
)
def test_the_command_never_runs_away_from_the_measurement(lead, ticks):
    # A blocked joint: whatever is chosen, and wherever it is pushed, its command stays near.
    limit = JointLimits(-1.0, 1.0, 2.0, 10.0, lead)
    bounds = JointBounds([limit], dt_s=DT_S)
    reach = lead + braking_distance(2.0, 10.0, DT_S)
    q, a, moved = 0.0, 0.0, 0.0
    for choice, push in ticks:
        measured = np.array([push])
        box = bounds.compute(np.array([q]), np.array([a]), measured)
        assert box.lower[0] <= box.upper[0]
        a = box.lower[0] if choice < 0.1 else box.upper[0]
        q += DT_S * a
        moved = max(moved, abs(q))
        # It follows pushes of up to 5 cm with its own acceleration.
        assert abs(q - push) <= reach + 0.1 + 1e-9
        assert abs(q) <= 1.0 + 1e-12
    assert moved > 0.0


@given(
    st.lists(st.tuples(st.floats(-2, 2), st.floats(-1, 1), st.floats(-2, 2), st.floats(0, 2))),
    st.floats(-5, 5),
)
def test_cut_line_holds_exactly_the_points_inside(joints, z):
    a = np.array([value for value, _, _, _ in joints])
    # Slopes that are not zero but nearly are decided by rounding.
    slope = np.array([round(value, 3) for _, value, _, _ in joints])
    low = np.array([low for _, _, low, _ in joints])
    box = Box(low, low + np.array([width for _, _, _, width in joints]))
    interval = box.cut_line(a, slope)
    point = a + z * slope
    margin = np.minimum(point - box.lower, box.upper - point)
    if (margin > 1e-9).all():
        assert interval is not None
        assert interval[0] <= z <= interval[1]
    if (margin < -1e-9).any():
        assert interval is None or not interval[0] <= z <= interval[1]


@given(st.lists(st.tuples(st.floats(-2, 2), st.floats(-2, 2), st.floats(0, 2)), min_size=1))
def test_clip_gives_the_nearest_point_of_the_box(joints):
    a = np.array([value for value, _, _ in joints])
    low = np.array([low for _, low, _ in joints])
    box = Box(low, low + np.array([width for _, _, width in joints]))
    clipped = box.clip(a)
    assert np.array_equal(clipped, np.clip(a, box.lower, box.upper))
    assert box.contains(clipped)
    assert box.contains(a) == np.array_equal(a, clipped)
