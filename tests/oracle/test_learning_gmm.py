"""Mixtures against torch.distributions and against their own definition."""

from __future__ import annotations

import pytest
import torch
from torch.distributions import Categorical, Independent, MixtureSameFamily, Normal

from services.policy.learning.gmm import Mixture, MixtureHead


@pytest.fixture(autouse=True, scope="module")
def _one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture
def mixture() -> Mixture:
    torch.manual_seed(0)
    head = MixtureHead(inputs=7, modes=5, dims=6, std_floor=0.01)
    return head(3.0 * torch.randn(4, 9, 7))


def test_log_prob_equals_torch_distributions(mixture: Mixture):
    reference = MixtureSameFamily(
        Categorical(logits=mixture.log_weights),
        Independent(Normal(mixture.means, mixture.stds), 1),
    )
    actions = torch.rand(4, 9, 6) * 2 - 1
    torch.testing.assert_close(mixture.log_prob(actions), reference.log_prob(actions))


def test_responsibilities_are_bayes(mixture: Mixture):
    actions = torch.rand(4, 9, 6) * 2 - 1
    density = Independent(Normal(mixture.means, mixture.stds), 1).log_prob(actions[..., None, :])
    joint = (mixture.log_weights + density).double().exp()
    expected = (joint / joint.sum(-1, keepdim=True)).float()
    gamma = mixture.responsibilities(actions)
    torch.testing.assert_close(gamma, expected, atol=1e-5, rtol=1e-4)
    assert not gamma.requires_grad


def test_responsibilities_weigh_the_gradient_of_the_means(mixture: Mixture):
    """d(-log p)/d mu_k = gamma_k (mu_k - a) / sigma_k^2."""
    actions = torch.rand(4, 9, 6) * 2 - 1
    (gradient,) = torch.autograd.grad(-mixture.log_prob(actions).sum(), mixture.means)
    gamma = mixture.responsibilities(actions)[..., None]
    expected = gamma * (mixture.means - actions[..., None, :]) / mixture.stds**2
    torch.testing.assert_close(gradient, expected, atol=1e-4, rtol=1e-4)


def test_far_away_actions_stay_finite(mixture: Mixture):
    actions = torch.full((4, 9, 6), 1e4)
    loss = -mixture.log_prob(actions).mean()
    (gradient,) = torch.autograd.grad(loss, mixture.means)
    assert torch.isfinite(loss)
    assert torch.isfinite(gradient).all()
    torch.testing.assert_close(mixture.responsibilities(actions).sum(-1), torch.ones(4, 9))


def test_ranges(mixture: Mixture):
    assert mixture.means.abs().max() < 1.0
    assert mixture.stds.min() > 0.01
    torch.testing.assert_close(mixture.log_weights.exp().sum(-1), torch.ones(4, 9))


def test_the_floor_holds():
    head = MixtureHead(inputs=1, modes=2, dims=6, std_floor=0.01)
    torch.nn.init.constant_(head.stds.bias, -1e4)
    torch.testing.assert_close(head(torch.zeros(1, 1)).stds, torch.full((1, 2, 6), 0.01))


def test_most_likely_mean(mixture: Mixture):
    mean = mixture.most_likely_mean()
    best = mixture.log_weights[2, 3].argmax()
    assert torch.equal(mean[2, 3], mixture.means[2, 3, best])
    assert mean.shape == (4, 9, 6)
