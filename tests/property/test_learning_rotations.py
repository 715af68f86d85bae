"""Rotations in torch against those of NumPy, and their gradients at rest."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from common import se3
from services.policy.learning.rotations import compose, exp3, log3, rotate

moderate = st.lists(st.floats(-1.5, 1.5), min_size=3, max_size=3)
tiny = st.lists(st.floats(-1e-3, 1e-3), min_size=3, max_size=3)


@pytest.fixture(autouse=True, scope="module")
def _one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@settings(max_examples=60)
@given(moderate | tiny)
def test_exp_equals_numpy(w: list[float]):
    R = exp3(torch.tensor(w, dtype=torch.float64))
    np.testing.assert_allclose(R, se3.exp3(w), atol=1e-14)


@settings(max_examples=60)
@given(moderate | tiny)
def test_log_inverts_exp(w: list[float]):
    vector = torch.tensor(w, dtype=torch.float64)
    torch.testing.assert_close(log3(exp3(vector)), vector, atol=1e-11, rtol=0)


@settings(max_examples=20)
@given(moderate | tiny, moderate)
def test_products(w: list[float], v: list[float]):
    x = torch.tensor(v).double()
    R, Q = exp3(torch.tensor(w).double()), exp3(x)
    torch.testing.assert_close(rotate(R, x), R @ x)
    torch.testing.assert_close(compose(R, Q), R @ Q)


def test_the_series_meets_the_quotient():
    """On either side of an angle of 1e-4."""
    axis = torch.tensor([0.6, 0.0, 0.8], dtype=torch.float64)
    for angle in (0.99e-4, 1.01e-4):
        w = (angle * axis).requires_grad_()
        R = exp3(w)
        np.testing.assert_allclose(R.detach(), se3.exp3((angle * axis).tolist()), rtol=1e-14)
        (gradient,) = torch.autograd.grad(R[0, 0], w)  # d/dw of 1 - b (y^2 + z^2)
        b, db = 0.5 - angle**2 / 24.0, -angle / 12.0
        y2 = (angle * axis[2]) ** 2
        expected = -db * axis * y2 - 2.0 * b * torch.stack([0 * y2, 0 * y2, angle * axis[2]])
        torch.testing.assert_close(gradient, expected, rtol=1e-7, atol=1e-16)


def there_and_back(w: torch.Tensor) -> torch.Tensor:
    return log3(exp3(w))


@pytest.mark.parametrize("size", [0.0, 1e-9, 0.9e-4, 1.1e-4, 1e-2, 1.0, 2.9])
def test_gradients_equal_differences(size: float):
    w = (size * torch.tensor([0.6, 0.0, 0.8], dtype=torch.float64)).requires_grad_()
    assert torch.autograd.gradcheck(exp3, [w])
    R = exp3(w.detach()).requires_grad_()
    assert torch.autograd.gradcheck(there_and_back, [w])
    assert torch.isfinite(torch.autograd.grad(log3(R).sum(), R)[0]).all()


def test_batches_and_single_precision():
    w = torch.randn(4, 5, 3, generator=torch.Generator().manual_seed(0))
    R = exp3(w)
    assert R.dtype == torch.float32
    torch.testing.assert_close(R[2, 3], exp3(w[2, 3]))
    torch.testing.assert_close(log3(R[..., :, :]), w, atol=3e-5, rtol=0)
