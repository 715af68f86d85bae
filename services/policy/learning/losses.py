"""The losses of the policy.

L = w_nll L_nll + w_grasp L_grasp + w_invar L_invar + w_future L_future, means over steps:
L_nll   = -log sum_k pi_k N(a*; mu_k, diag sigma_k^2)            normalised actions
L_grasp = binary cross-entropy of the logit, heavier around transitions
L_invar = sum_k gamma_k |phi(history, mu_k) - phi(history, u*)|^2      mu_k in m and rad,
gamma_k = pi_k N(a*; mu_k, sigma_k) / p(a*), without gradient
L_future = mean over horizons h and dimensions of huber((f_h - d_h) / S_h), where the hand is seen
to be h steps later: d_h = T_t^-1 T_{t+h} as translation and rotation vector, S_h its spread

Why gamma: a sample of a mixture has no gradient, its mean averages modes, and pi would punish modes
that explain other demonstrations. gamma is the weight with which the gradient of L_nll itself
reaches each mean.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from common.errors import InvalidValue
from services.policy.learning.config import InvariantForm, InvariantLossConfig, NetworkConfig
from services.policy.learning.gmm import Mixture
from services.policy.learning.invariants import compute_invariants
from services.policy.learning.network import POSE_DIMS, PolicyOutput
from services.policy.learning.normalization import ActionStatistics, MotionScale, normalise_grasp


@dataclass(frozen=True)
class Targets:
    """What was demonstrated in a batch of windows.

    Args:
        actions: (B, T, 6) translation [m] and rotation vector [rad].
        grasp: (B, T) 1 = closed, 0 = open.
        grasp_weight: (B, T) weight of each step in the grasp loss.
        history: (B, T, history_steps of the loss, 6) [m, rad] demonstrated actions before each
            step, oldest first, zero before the start.
        future: (B, T, horizons, 6) where the hand is seen to be later, in units of its spread.
    """

    actions: Tensor
    grasp: Tensor
    grasp_weight: Tensor
    history: Tensor
    future: Tensor | None = None


@dataclass(frozen=True)
class LossTerms:
    """Terms before weighting; None where the method has none."""

    total: Tensor
    nll: Tensor
    grasp: Tensor | None
    invariant: Tensor | None
    future: Tensor | None = None


def compute_loss(
    output: PolicyOutput, targets: Targets, *, config: NetworkConfig, statistics: ActionStatistics
) -> LossTerms:
    """All terms of a method's loss.

    Raises:
        InvalidValue: The history is not as long as the config says.
    """
    mixture, loss = output.mixture, config.loss
    normalised = normalise_targets(targets, statistics=statistics, head=config.head)
    nll = -mixture.log_prob(normalised).mean()
    total = loss.nll * nll
    grasp = invariant = None
    if loss.grasp is not None and output.grasp_logit is not None:
        grasp = compute_grasp_loss(output.grasp_logit, targets.grasp, targets.grasp_weight)
        total = total + loss.grasp.weight * grasp
    if loss.invariant is not None:
        gamma = mixture.responsibilities(normalised)
        invariant = compute_invariant_loss(
            mixture, gamma, targets, config=loss.invariant, statistics=statistics
        )
        total = total + loss.invariant.weight * invariant
    future = None
    if loss.future is not None and output.future is not None and targets.future is not None:
        future = functional.smooth_l1_loss(output.future, targets.future)
        total = total + loss.future.weight * future
    return LossTerms(total=total, nll=nll, grasp=grasp, invariant=invariant, future=future)


def normalise_targets(targets: Targets, *, statistics: ActionStatistics, head: str) -> Tensor:
    """(B, T, 6) a* = u* / s; with the grasp in the mixture (B, T, 7), see `normalise_grasp`."""
    pose = targets.actions / targets.actions.new_tensor(statistics.scale)
    if head == "separate-grasp":
        return pose
    grasp = normalise_grasp(targets.grasp.to(pose.dtype))
    return torch.cat([pose, grasp[..., None]], dim=-1)


def compute_grasp_weights(grasp: Tensor, *, transition_weight: float, steps: int) -> Tensor:
    """Weight of each step in the grasp loss; of whole episodes, so that no window hides a change.

    Args:
        grasp: (..., N) 1 = closed, 0 = open, over an episode.
        transition_weight: Weight of a step near a transition; 1 elsewhere.
        steps: N_near: near = within this many steps on either side of the change.

    Returns:
        (..., N) float32.
    """
    changes = (grasp[..., 1:] != grasp[..., :-1]).float()
    # Change j lies between the steps j and j + 1: both are 1 step from it.
    padded = functional.pad(changes, (steps, steps))
    near = torch.zeros(grasp.shape, device=grasp.device)
    for shift in range(2 * steps):
        near = torch.maximum(near, padded[..., shift : shift + grasp.shape[-1]])
    return 1.0 + (transition_weight - 1.0) * near


def compute_grasp_loss(logit: Tensor, grasp: Tensor, weight: Tensor) -> Tensor:
    """Weighted mean of -g log p - (1-g) log(1-p), p = sigmoid(logit); all (B, T)."""
    losses = functional.binary_cross_entropy_with_logits(
        logit, grasp.to(logit.dtype), reduction="none"
    )
    return (weight * losses).sum() / weight.sum()


def compute_invariant_loss(
    mixture: Mixture,
    gamma: Tensor,
    targets: Targets,
    *,
    config: InvariantLossConfig,
    statistics: ActionStatistics,
) -> Tensor:
    """L_invar of the component means.

    Args:
        mixture: Over normalised actions (B, T); a seventh dimension is left out.
        gamma: (B, T, K) responsibilities, without gradient.
        targets: What was demonstrated.
        config: History and form.
        statistics: Units.

    Raises:
        InvalidValue: The history is not as long as the config says.
    """
    if targets.history.shape[-2] != config.history_steps:
        raise InvalidValue(
            "history", list(targets.history.shape), f"{config.history_steps} steps of 6 numbers"
        )
    means = mixture.means[..., :POSE_DIMS]
    predicted = means * means.new_tensor(statistics.scale)
    errors = compute_chunk_error(
        targets.history[..., None, :, :],
        predicted[..., None, :],
        targets.actions[..., None, None, :],
        form=config.form,
        scale=statistics.motion_scale,
    )
    return (gamma * errors).sum(dim=-1).mean()


def compute_chunk_error(
    history: Tensor,
    predicted: Tensor,
    demonstrated: Tensor,
    *,
    form: InvariantForm,
    scale: MotionScale,
    valid: Tensor | None = None,
) -> Tensor:
    """|phi(history, predicted) - phi(history, demonstrated)|^2; the leading axes broadcast.

    Args:
        history: (..., T, 6) demonstrated actions [m, rad].
        predicted: (..., P + 1, 6) predicted actions [m, rad].
        demonstrated: (..., P + 1, 6) demonstrated actions [m, rad].
        form: Which invariants.
        scale: Units of the smooth form.
        valid: (..., P + 1) false beyond the end of the episode: rest on both sides, which has
            neither length nor direction and so no error.

    Returns:
        (...) sum over the invariants.
    """
    if valid is not None:
        predicted = torch.where(valid[..., None], predicted, 0.0)
        demonstrated = torch.where(valid[..., None], demonstrated, 0.0)
    expected = _after(history, demonstrated, form=form, scale=scale)
    difference = _after(history, predicted, form=form, scale=scale) - expected
    return (difference * difference).sum(dim=-1)


def _after(history: Tensor, chunk: Tensor, *, form: InvariantForm, scale: MotionScale) -> Tensor:
    """Phi of a history followed by a chunk."""
    leading = torch.broadcast_shapes(history.shape[:-2], chunk.shape[:-2])
    deltas = [x.expand(*leading, *x.shape[-2:]) for x in (history, chunk)]
    return compute_invariants(torch.cat(deltas, dim=-2), form=form, scale=scale)
