"""The invariants against a NumPy twin and the path they came from; their gradients."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
import torch

from common.se3 import apply_differential
from services.policy.learning.config import InvariantForm, PaperForm, SmoothForm
from services.policy.learning.invariants import compute_invariants, compute_motion_vectors
from services.policy.learning.normalization import MotionScale
from tests import invariants_reference as reference

SCALE = MotionScale(step_m=0.017, turn_rad=0.05)
SMOOTH = SmoothForm()
FULL = PaperForm()
FORMS = [SMOOTH, FULL, PaperForm(full=False)]


@pytest.fixture(autouse=True, scope="module")
def _one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def phi(deltas: torch.Tensor, form: InvariantForm = SMOOTH) -> torch.Tensor:
    return compute_invariants(deltas, form=form, scale=SCALE)


def expected_phi(deltas: np.ndarray, form: InvariantForm) -> np.ndarray:
    v, w = reference.steps_and_turns(deltas)
    if isinstance(form, PaperForm):
        return np.concatenate([reference.paper(x, full=form.full) for x in (v, w)])
    linear = reference.smooth(v, e=1e-3, e_s=1e-3, S=SCALE.step_m)
    return np.concatenate([linear, reference.smooth(w, e=5e-3, e_s=1e-3, S=SCALE.turn_rad)])


@pytest.mark.parametrize("form", FORMS, ids=str)
@pytest.mark.parametrize("count", [3, 4, 18])
def test_equals_the_numpy_twin(form: InvariantForm, count: int):
    deltas = reference.random_deltas(7 * count).reshape(7, count, 6)
    expected = [expected_phi(x, form) for x in deltas]
    np.testing.assert_allclose(phi(torch.tensor(deltas), form), expected, atol=1e-12)


@pytest.mark.parametrize("form", FORMS, ids=str)
def test_float32_input_keeps_single_precision(form: InvariantForm):
    deltas = reference.random_deltas(300).reshape(100, 3, 6)
    exact = phi(torch.tensor(deltas, dtype=torch.float32).double(), form)
    rounded = phi(torch.tensor(deltas, dtype=torch.float32), form)
    torch.testing.assert_close(rounded.double(), exact, atol=2e-5, rtol=0)


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16], ids=str)
def test_autocast_does_not_round(dtype: torch.dtype):
    deltas = torch.tensor(reference.random_deltas(50).reshape(10, 5, 6)).to(dtype)
    expected = phi(deltas.float())
    with torch.autocast("cpu", dtype=torch.bfloat16):
        torch.testing.assert_close(phi(deltas), expected, atol=0, rtol=0)


@pytest.mark.parametrize(
    ("form", "count", "values"),
    [
        (SMOOTH, 3, 18),
        (SMOOTH, 1, 2),
        (SMOOTH, 2, 8),
        (FULL, 3, 18),
        (PaperForm(full=False), 3, 10),
    ],
    ids=str,
)
def test_number_of_values(form: InvariantForm, count: int, values: int):
    assert phi(torch.zeros(4, count, 6), form).shape == (4, values)


def angles_of(values: np.ndarray, form: InvariantForm, e: float, S: float):
    """Lengths, bends and torsions from one half of phi of 40 vectors."""
    m, a, b, c, d = np.split(values, np.cumsum([40, 39, 39, 38]))
    if isinstance(form, PaperForm):  # sin 2th = 2 sin th cos th
        return m, np.arctan2(a, b / (2 * a)), np.arctan2(c, d / (2 * c))
    root = m * S + e
    m = np.sqrt(root**2 - e**2)
    h = m / root
    return m, np.arccos(a / (h[:-1] * h[1:])), np.arctan2(h[1:-1] * d, c)


@pytest.mark.parametrize("form", [SMOOTH, FULL], ids=str)
def test_a_path_can_be_rebuilt(form: InvariantForm):
    deltas = reference.random_deltas(40, seed=3)
    halves = np.split(phi(torch.tensor(deltas), form).numpy(), 2)
    constants = [(SMOOTH.epsilon_m, SCALE.step_m), (SMOOTH.epsilon_rad, SCALE.turn_rad)]
    vectors = reference.steps_and_turns(deltas)
    for values, original, (e, S) in zip(halves, vectors, constants, strict=True):
        m, th1, th2 = angles_of(values, form, e, S)
        y = np.cross(original[0], original[1])
        x = original[0] / np.linalg.norm(original[0])
        rebuilt = reference.rebuild(m, th1, th2, x=x, y=y / np.linalg.norm(y))
        np.testing.assert_allclose(rebuilt, original, atol=1e-10)


def test_steps_end_where_the_poses_end():
    deltas = reference.random_deltas(12)
    v, _ = compute_motion_vectors(torch.tensor(deltas))
    pose = np.eye(4)
    for delta in deltas:
        pose = apply_differential(pose, delta[:3], delta[3:])
    np.testing.assert_allclose(v.sum(0), pose[:3, 3], atol=1e-14)


def special_deltas(case: str, rows: int = 400) -> torch.Tensor:
    """(rows, 3, 6) histories of two steps and a last one, of the kinds that break the formulas."""
    deltas = torch.tensor(reference.random_deltas(3 * rows, seed=1).reshape(rows, 3, 6))
    first = deltas[:, :1]
    noise = (
        1e-6 * torch.tensor(reference.random_deltas(3 * rows, seed=2).reshape(rows, 3, 6)) / 0.01
    )
    match case:
        case "random":
            return deltas
        case "zero history":
            return torch.cat([0.0 * deltas[:, :2], deltas[:, 2:]], dim=1)
        case "zero action":
            return torch.cat([deltas[:, :2], 0.0 * deltas[:, 2:]], dim=1)
        case "pause":
            return deltas * torch.tensor([1.0, 0.0, 1.0])[:, None]
        case "all zero":
            return 0.0 * deltas
        case "straight history":
            return torch.cat([first, first, deltas[:, 2:]], dim=1) * torch.tensor(
                [1.0] * 3 + [0.0] * 3
            )
        case "straight":
            return first.repeat(1, 3, 1) * torch.tensor([1.0] * 3 + [0.0] * 3)
        case "reversed":
            return torch.cat([first, first, -first], dim=1) * torch.tensor([1.0] * 3 + [0.0] * 3)
        case "pure turning":
            return first.repeat(1, 3, 1) * torch.tensor([0.0] * 3 + [1.0] * 3)
        case "straight with 1 um noise":
            return first.repeat(1, 3, 1) * torch.tensor([1.0] * 3 + [0.0] * 3) + noise
        case "only 1 um noise":
            return noise
        case _:
            raise AssertionError(case)


CASES = [
    "random",
    "zero history",
    "zero action",
    "pause",
    "all zero",
    "straight history",
    "straight",
    "reversed",
    "pure turning",
    "straight with 1 um noise",
    "only 1 um noise",
]


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64], ids=str)
@pytest.mark.parametrize("form", FORMS, ids=str)
@pytest.mark.parametrize("case", CASES)
def test_finite_values_and_gradients(case: str, form: InvariantForm, dtype: torch.dtype):
    deltas = special_deltas(case).to(dtype).requires_grad_()
    values = phi(deltas, form)
    (gradient,) = torch.autograd.grad((values * values + values).sum(), deltas)
    assert torch.isfinite(values).all()
    assert torch.isfinite(gradient).all()
    if form is SMOOTH:
        assert gradient.norm(dim=(-2, -1)).max() < 1e4


@pytest.mark.parametrize("case", CASES)
def test_smooth_gradient_equals_differences(case: str):
    deltas = special_deltas(case, rows=2).requires_grad_()
    assert torch.autograd.gradcheck(phi, [deltas], eps=1e-7, atol=1e-4)


@pytest.mark.parametrize("full", [True, False])
def test_paper_gradient_equals_differences(full: bool):
    deltas = special_deltas("random", rows=4).requires_grad_()
    function = partial(phi, form=PaperForm(full=full))
    assert torch.autograd.gradcheck(function, [deltas], eps=1e-8, atol=1e-4)


@pytest.mark.parametrize("form", [SMOOTH, FULL], ids=str)
def test_ten_thousand_steps_from_rest(form: InvariantForm):
    last = torch.tensor(reference.random_deltas(10_000, seed=5), dtype=torch.float32)
    last[::10] = 0.0
    history = torch.zeros(10_000, 2, 6)
    last.requires_grad_()
    values = phi(torch.cat([history, last[:, None]], dim=1), form)
    (gradient,) = torch.autograd.grad(values.square().sum(), last)
    assert torch.isfinite(values).all()
    assert torch.isfinite(gradient).all()
    moving = gradient.norm(dim=-1) > 0
    assert not moving[::10].any()
    assert moving.sum() == 9_000


def test_gradients_of_random_steps_are_moderate():
    """Of single values: about 1/e for directions that fade in over e = 1 mm."""
    deltas = special_deltas("random").requires_grad_()
    largest = max(
        torch.autograd.grad(column.sum(), deltas, retain_graph=True)[0].norm(dim=(-2, -1)).max()
        for column in phi(deltas).unbind(-1)
    )
    assert 50.0 < largest < 1000.0


def last_action_effect(direction: list[float], form: InvariantForm) -> float:
    """Size of d phi / d u_t along a direction, for a history that goes along x, then bends to y."""
    history = torch.tensor([[0.01, 0, 0, 0, 0, 0], [0.007, 0.007, 0, 0, 0, 0]]).double()

    def last(s: torch.Tensor) -> torch.Tensor:
        move = torch.tensor([*direction, 0.0, 0.0, 0.0]).double()
        u = torch.tensor([0.0, 0.01, 0.0, 0.0, 0.0, 0.0]).double() + s * move
        return phi(torch.cat([history, u[None]]), form)

    jacobian = torch.autograd.functional.jacobian(last, torch.zeros((), dtype=torch.float64))
    assert isinstance(jacobian, torch.Tensor)
    return float(jacobian.norm())


LENGTH, BEND, TORSION = [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]


@pytest.mark.parametrize("form", [SMOOTH, FULL], ids=str)
@pytest.mark.parametrize("direction", [LENGTH, BEND, TORSION], ids=["length", "bend", "torsion"])
def test_the_last_action_is_seen(direction: list[float], form: InvariantForm):
    assert last_action_effect(direction, form) > 0.5


def test_the_papers_index_range_sees_only_the_torsion():
    form = PaperForm(full=False)
    assert last_action_effect(LENGTH, form) < 1e-10
    assert last_action_effect(BEND, form) < 1e-10
    assert last_action_effect(TORSION, form) > 0.5
    deltas = special_deltas("random")
    longer = deltas * torch.tensor([1.0, 1.0, 3.0])[:, None]
    torch.testing.assert_close(phi(longer, form), phi(deltas, form), atol=1e-14, rtol=0)


def test_a_reversal_is_seen_by_the_smooth_form_only():
    straight, reversed_ = special_deltas("straight"), special_deltas("reversed")
    torch.testing.assert_close(phi(straight, FULL), phi(reversed_, FULL), atol=1e-12, rtol=0)
    bend = slice(3, 5)
    difference = (phi(straight) - phi(reversed_))[:, bend].abs().max(dim=-1).values
    assert difference.min() > 1.5


def moves(*directions: list[float]) -> torch.Tensor:
    """Deltas of 1 cm along directions, without turning."""
    turns = [[0.0] * 3] * len(directions)
    return 0.01 * torch.cat([torch.tensor(directions), torch.tensor(turns)], dim=-1).double()


X, Y, Z, REST = [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]


def test_the_papers_axes_are_carried_over_a_pause():
    values = phi(moves(X, REST, Y), FULL)[:9].tolist()
    m, sin1, double1, torsion = values[:3], values[3:5], values[5:7], values[7:]
    assert m == pytest.approx([0.01, 0.0, 0.01])
    assert sin1 == pytest.approx([0.0, 1.0])
    assert double1 == pytest.approx([0.0, 0.0])
    assert torsion == pytest.approx([0.0, 0.0])


def test_a_step_below_rounding_has_no_direction_in_the_papers_form():
    rest, almost = moves(X, REST, Y), moves(X, [0.0, 0.0, 1e-6], Y)
    torch.testing.assert_close(phi(almost, FULL), phi(rest, FULL), atol=1e-9, rtol=0)


def test_the_papers_axes_are_carried_over_a_straight_stretch():
    """Bend to y about z, straight on, bend to z about x: a torsion of a quarter."""
    values = phi(moves(X, Y, Y, Z), FULL)[:14].tolist()
    assert values[4:7] == pytest.approx([1.0, 0.0, 1.0])
    assert values[10:12] == pytest.approx([0.0, 1.0])


def test_a_bend_below_rounding_has_no_plane_in_the_papers_form():
    almost = moves(X, [1.0, 1e-8, 0.0], [1.0, 0.0, 1e-8]).requires_grad_()
    values = phi(almost, FULL)
    torch.testing.assert_close(values, phi(moves(X, X, X), FULL), atol=1e-9, rtol=0)
    (gradient,) = torch.autograd.grad(values.sum(), almost)
    assert gradient.abs().max() < 1e3
