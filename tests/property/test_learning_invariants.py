"""What changes the invariants and what does not."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from common.se3 import apply_differential, exp3, make_pose
from services.policy.learning.config import InvariantForm, PaperForm, SmoothForm
from services.policy.learning.invariants import compute_invariants
from services.policy.learning.normalization import MotionScale
from tests.invariants_reference import Array, deltas_of, random_deltas
from tests.messages_strategy import rotation_vector

SCALE = MotionScale(step_m=0.017, turn_rad=0.05)
FORMS = [SmoothForm(), PaperForm(), PaperForm(full=False)]
STEPS = 5
seeds = st.integers(0, 2**20)
offsets = st.lists(st.floats(-2, 2), min_size=3, max_size=3)


@pytest.fixture(autouse=True, scope="module")
def _one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def random_path(seed: int) -> list[Array]:
    """Poses of a tool in the world."""
    poses = [make_pose(exp3([0.3, -0.2, 0.5]), [0.4, 0.1, 0.2])]
    for delta in random_deltas(STEPS, seed=seed):
        poses.append(apply_differential(poses[-1], delta[:3], delta[3:]))
    return poses


def phi(poses: list[Array], form: InvariantForm) -> Array:
    deltas = torch.tensor(deltas_of(poses))
    return compute_invariants(deltas, form=form, scale=SCALE).numpy()


@pytest.mark.parametrize("form", FORMS, ids=str)
@settings(max_examples=20)
@given(seed=seeds, w=rotation_vector, p=offsets)
def test_motion_of_the_world_changes_nothing(
    form: InvariantForm, seed: int, w: list[float], p: list[float]
):
    path, T_world_new = random_path(seed), make_pose(exp3(w), p)
    moved = [T_world_new @ T for T in path]
    np.testing.assert_allclose(phi(moved, form), phi(path, form), atol=1e-9)


@pytest.mark.parametrize("form", FORMS, ids=str)
@settings(max_examples=20)
@given(seed=seeds, w=rotation_vector)
def test_rotation_of_the_tool_changes_nothing(form: InvariantForm, seed: int, w: list[float]):
    path, T_tool_new = random_path(seed), make_pose(exp3(w), [0.0] * 3)
    turned = [T @ T_tool_new for T in path]
    np.testing.assert_allclose(phi(turned, form), phi(path, form), atol=1e-9)


@pytest.mark.parametrize("form", FORMS, ids=str)
@settings(max_examples=20)
@given(seed=seeds)
def test_a_lever_arm_changes_the_linear_part_only(form: InvariantForm, seed: int):
    path, T_tool_new = random_path(seed), make_pose(np.eye(3), [0.2, 0.0, 0.0])
    offset = [T @ T_tool_new for T in path]
    difference = np.abs(phi(offset, form) - phi(path, form))
    linear, angular = np.split(difference, 2)
    assert linear.max() > 1e-2
    assert angular.max() < 1e-9


@settings(max_examples=20)
@given(seed=seeds, factor=st.floats(0.5, 4.0))
def test_scale_leaves_the_papers_angles(seed: int, factor: float):
    deltas = torch.tensor(random_deltas(STEPS, seed=seed))
    larger = deltas * torch.tensor([factor] * 3 + [1.0] * 3, dtype=torch.float64)
    values, scaled = (
        compute_invariants(x, form=PaperForm(), scale=SCALE) for x in (deltas, larger)
    )
    torch.testing.assert_close(scaled[:STEPS], factor * values[:STEPS], atol=1e-12, rtol=0)
    torch.testing.assert_close(scaled[STEPS:], values[STEPS:], atol=1e-9, rtol=0)


@settings(max_examples=20)
@given(seed=seeds)
def test_sampling_in_time_matters(seed: int):
    path = random_path(seed)
    coarse, fine = phi(path[:5:2], SmoothForm()), phi(path[:3], SmoothForm())
    assert np.abs(coarse - fine).max() > 1e-2
