"""Gaussian mixtures with diagonal covariance over normalised actions.

p(a) = sum_k pi_k N(a; mu_k, diag sigma_k^2),  pi = softmax(l),  mu = tanh(m),
sigma = softplus(s) + floor
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

_LOG_2PI = math.log(2.0 * math.pi)


@dataclass(frozen=True)
class Mixture:
    """Parameters of one mixture per step.

    Args:
        log_weights: (..., K) log pi.
        means: (..., K, D) mu in (-1, 1).
        stds: (..., K, D) sigma.
    """

    log_weights: Tensor
    means: Tensor
    stds: Tensor

    def joint_log_prob(self, actions: Tensor) -> Tensor:
        """(..., K) log pi_k N(a; mu_k, sigma_k) of actions (..., D)."""
        z = (actions[..., None, :] - self.means) / self.stds
        log_density = -0.5 * (z * z + _LOG_2PI) - self.stds.log()
        return self.log_weights + log_density.sum(dim=-1)

    def log_prob(self, actions: Tensor) -> Tensor:
        """(...) log p(a) of actions (..., D)."""
        return torch.logsumexp(self.joint_log_prob(actions), dim=-1)

    def responsibilities(self, actions: Tensor) -> Tensor:
        """(..., K) share gamma_k of each component in p(a); without gradient."""
        return torch.softmax(self.joint_log_prob(actions).detach(), dim=-1)

    def most_likely_mean(self) -> Tensor:
        """(..., D) mean of the component with the largest weight: the deterministic action."""
        component = self.log_weights.argmax(dim=-1)
        index = component[..., None, None].expand(*component.shape, 1, self.means.shape[-1])
        return self.means.gather(-2, index).squeeze(-2)


class MixtureHead(nn.Module):
    """Features to mixture.

    Args:
        inputs: Number of features.
        modes: K components.
        dims: D numbers of an action.
        std_floor: Smallest sigma, in normalised units.
    """

    def __init__(self, *, inputs: int, modes: int, dims: int, std_floor: float) -> None:
        super().__init__()
        self.means = nn.Linear(inputs, modes * dims)
        self.stds = nn.Linear(inputs, modes * dims)
        self.weights = nn.Linear(inputs, modes)
        self._shape = (modes, dims)
        self._std_floor = std_floor

    def forward(self, features: Tensor) -> Mixture:
        """(..., inputs) -> mixture in float32, also under autocast."""
        means: Tensor = self.means(features).float()
        stds: Tensor = self.stds(features).float()
        weights: Tensor = self.weights(features).float()
        return Mixture(
            log_weights=torch.log_softmax(weights, dim=-1),
            means=torch.tanh(means).unflatten(-1, self._shape),
            stds=(functional.softplus(stds) + self._std_floor).unflatten(-1, self._shape),
        )
