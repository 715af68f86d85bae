"""The gripper reference: continuous, arrives, and its twist is its derivative."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.messages import ActionStep
from common.se3 import apply_differential, distance, exp3, log3, make_pose
from services.retarget.reference import GripperReference, WaypointInterpolator

vectors = st.lists(st.floats(-0.3, 0.3), min_size=3, max_size=3)
turns = st.lists(st.floats(-1.2, 1.2), min_size=3, max_size=3)
poses = st.builds(lambda p, w: make_pose(exp3(w), p), vectors, turns)
steps = st.builds(
    lambda d, w: ActionStep(translation_m=d, rotation_rad=w, grasp=False), vectors, turns
)


def _same(T, other, tolerance=1e-12):
    return max(distance(T, other)) <= tolerance


@given(poses, poses)
def test_ten_ticks_lead_to_the_waypoint_and_then_rest(T_start, T_waypoint):
    interpolator = WaypointInterpolator(T_start)
    interpolator.aim(T_waypoint)
    for _ in range(10):
        assert not interpolator.arrived
        interpolator.advance()
    assert interpolator.arrived
    assert np.array_equal(interpolator.T_world_reference, T_waypoint)
    held = interpolator.advance()
    assert np.array_equal(held.T_world_start, T_waypoint)
    assert np.array_equal(held.T_world_end, T_waypoint)
    assert np.array_equal(held.twist, np.zeros(6))


@given(poses, poses)
def test_twist_is_the_derivative(T_start, T_waypoint):
    interpolator = WaypointInterpolator(T_start)
    interpolator.aim(T_waypoint)
    for _ in range(10):
        tick = interpolator.advance()
        linear = (tick.T_world_end[:3, 3] - tick.T_world_start[:3, 3]) / 0.01
        angular = log3(tick.T_world_end[:3, :3] @ tick.T_world_start[:3, :3].T) / 0.01
        assert tick.twist == pytest.approx(np.concatenate([linear, angular]), abs=1e-9)


@settings(max_examples=50)
@given(
    poses,
    st.lists(st.tuples(st.lists(steps, min_size=1, max_size=3), st.integers(1, 25)), max_size=4),
)
def test_reference_is_continuous_and_ends_at_the_composed_setpoint(T_start, actions):
    reference = GripperReference(T_start, lead=None)
    T_last, T_setpoint = T_start, T_start
    for chunk, ticks in actions:
        reference.take(chunk)
        for _ in range(ticks):
            tick = reference.advance()
            assert np.array_equal(tick.T_world_start, T_last)
            T_last = tick.T_world_end
        # One step begins at once and a further one after every ten ticks.
        for step in chunk[: 1 + (ticks - 1) // 10]:
            T_setpoint = apply_differential(T_setpoint, step.translation_m, step.rotation_rad)
        left = chunk[1 + (ticks - 1) // 10 :]
        T_end = T_setpoint
    if actions:
        for step in left:
            T_end = apply_differential(T_end, step.translation_m, step.rotation_rad)
    for _ in range(40):
        T_last = reference.advance().T_world_end
    assert _same(T_last, T_end if actions else T_start)


def test_a_chunk_is_consumed_one_step_per_ten_ticks():
    forward = ActionStep(translation_m=[0.1, 0.0, 0.0], rotation_rad=[0.0] * 3, grasp=False)
    reference = GripperReference(np.eye(4), lead=None)
    reference.take([forward, forward, forward])
    x = [float(reference.advance().T_world_end[0, 3]) for _ in range(35)]
    assert x[9] == pytest.approx(0.1)
    assert x[19] == pytest.approx(0.2)
    assert x[29:] == pytest.approx([0.3] * 6)


def test_a_new_action_replaces_the_rest_of_a_chunk_and_starts_where_the_reference_is():
    forward = ActionStep(translation_m=[0.1, 0.0, 0.0], rotation_rad=[0.0] * 3, grasp=False)
    left = ActionStep(translation_m=[0.0, 0.1, 0.0], rotation_rad=[0.0] * 3, grasp=False)
    reference = GripperReference(np.eye(4), lead=None)
    reference.take([forward, forward, forward])
    for _ in range(5):
        reference.advance()
    reference.take([left])
    tick = reference.advance()
    assert tick.T_world_start[:3, 3] == pytest.approx([0.05, 0.0, 0.0])
    # Composed on the set-point, so nothing of the first step is lost.
    assert tick.twist[:3] == pytest.approx([0.5, 1.0, 0.0])
    for _ in range(15):
        tick = reference.advance()
    assert tick.T_world_end[:3, 3] == pytest.approx([0.1, 0.1, 0.0])


def test_actions_are_expressed_in_the_setpoint_frame():
    quarter = ActionStep(translation_m=[0.0] * 3, rotation_rad=[0.0, 0.0, np.pi / 2], grasp=False)
    forward = ActionStep(translation_m=[0.1, 0.0, 0.0], rotation_rad=[0.0] * 3, grasp=False)
    reference = GripperReference(np.eye(4), lead=None)
    reference.take([quarter, forward])
    for _ in range(20):
        tick = reference.advance()
    assert tick.T_world_end[:3, 3] == pytest.approx([0.0, 0.1, 0.0], abs=1e-12)
