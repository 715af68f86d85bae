"""Other ways to write rotations: equal to SciPy's, there and back."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from common.formats.rotations import (
    quaternions_from_vectors,
    rpy_from_vectors,
    vectors_from_quaternions,
    vectors_from_rpy,
)

RANDOM = np.random.default_rng(0)
VECTORS = np.concatenate(
    [
        np.zeros((1, 3)),
        1e-12 * np.eye(3),
        1e-5 * RANDOM.normal(size=(20, 3)),
        RANDOM.uniform(-1.7, 1.7, (200, 3)),
    ]
)


def test_quaternions():
    expected = Rotation.from_rotvec(VECTORS).as_quat(canonical=True, scalar_first=True)
    assert np.allclose(quaternions_from_vectors(VECTORS), expected, atol=1e-14)
    assert np.allclose(vectors_from_quaternions(expected), VECTORS, atol=1e-14)
    assert np.allclose(vectors_from_quaternions(-expected), VECTORS, atol=1e-14)


def test_roll_pitch_yaw_is_about_fixed_axes():
    expected = Rotation.from_rotvec(VECTORS).as_euler("xyz")
    assert np.allclose(rpy_from_vectors(VECTORS), expected, atol=1e-7)
    assert np.allclose(vectors_from_rpy(expected), VECTORS, atol=1e-7)


@pytest.mark.parametrize("angles", [(0.4, 0.0, 0.0), (0.0, -0.3, 0.0), (0.0, 0.0, 0.2)])
def test_a_turn_about_one_axis_is_the_same_in_both(angles):
    assert np.allclose(vectors_from_rpy(np.array([angles])), [angles], atol=1e-15)
