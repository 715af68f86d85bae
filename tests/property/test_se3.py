from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from common.se3 import (
    apply_differential,
    differential,
    distance,
    exp3,
    invert,
    log3,
    make_pose,
    matrix_from_quat,
    pose_from_wire,
    pose_to_wire,
    quat_from_matrix,
)
from tests.messages_strategy import rotation_vector

position = st.lists(st.floats(-10, 10), min_size=3, max_size=3)
poses = st.builds(lambda w, p: make_pose(exp3(w), p), rotation_vector, position)


@given(rotation_vector)
def test_exp_is_a_rotation(w: list[float]):
    R = exp3(w)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)
    assert abs(np.linalg.det(R) - 1.0) < 1e-13


@given(rotation_vector)
def test_log_inverts_exp(w: list[float]):
    np.testing.assert_allclose(log3(exp3(w)), w, atol=1e-11)


@given(rotation_vector)
def test_quaternion_round_trip(w: list[float]):
    R = exp3(w)
    quat = quat_from_matrix(R)
    assert quat[0] >= 0.0
    np.testing.assert_allclose(matrix_from_quat(quat), R, atol=1e-14)


@given(st.lists(st.floats(-1, 1), min_size=3, max_size=3).filter(lambda v: np.linalg.norm(v) > 0.1))
def test_half_turns(axis: list[float]):
    """The angle pi is where naive logarithms divide by zero."""
    n = np.array(axis) / np.linalg.norm(axis)
    R = 2.0 * np.outer(n, n) - np.eye(3)
    w = log3(R)
    assert abs(np.linalg.norm(w) - np.pi) < 1e-7
    np.testing.assert_allclose(exp3(w), R, atol=1e-7)


@given(poses)
def test_inverse(T: np.ndarray):
    np.testing.assert_allclose(invert(T) @ T, np.eye(4), atol=1e-13)


@given(poses)
def test_wire_round_trip(T: np.ndarray):
    np.testing.assert_allclose(pose_from_wire(pose_to_wire(T)), T, atol=1e-13)


@given(poses, poses)
def test_differential_takes_one_pose_to_the_other(T_a_b: np.ndarray, T_a_c: np.ndarray):
    translation, rotation = differential(T_a_b, T_a_c)
    np.testing.assert_allclose(apply_differential(T_a_b, translation, rotation), T_a_c, atol=1e-6)


@given(poses, poses, poses)
def test_differential_does_not_see_the_world(
    T_world_b: np.ndarray, T_world_c: np.ndarray, T_new_world: np.ndarray
):
    """An action is expressed in the set-point's frame: moving the world changes nothing."""
    here = differential(T_world_b, T_world_c)
    there = differential(T_new_world @ T_world_b, T_new_world @ T_world_c)
    np.testing.assert_allclose(here[0], there[0], atol=1e-12)
    np.testing.assert_allclose(exp3(here[1]), exp3(there[1]), atol=1e-12)


@given(poses, poses)
def test_distance_is_symmetric(T_a: np.ndarray, T_b: np.ndarray):
    np.testing.assert_allclose(distance(T_a, T_b), distance(T_b, T_a), atol=1e-9)


def test_thousands_of_compositions_stay_rigid():
    T = np.eye(4)
    for _ in range(10_000):
        T = apply_differential(T, [1e-3, 2e-3, 0.0], [0.01, -0.02, 0.03])
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-14)
