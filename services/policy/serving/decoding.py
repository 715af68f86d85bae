"""From what the network says to an action; NumPy, the same for every backend."""

from __future__ import annotations

import math
from typing import Literal, TypeAlias

import numpy as np

from services.policy.learning.checkpoint import GraspHysteresis
from services.policy.learning.normalization import denormalise_grasp
from services.policy.learning.onnx_signature import POSE_DIMS
from services.policy.serving.backend import Floats

Decoding: TypeAlias = Literal["most-likely", "sample"]
"""The mean of the most likely component, or of one drawn by its weight, with little noise."""

LOW_NOISE_STD = 1e-4
"""Of samples, in normalised units (as robomimic evaluates)."""


def choose_action(
    log_weights: Floats, means: Floats, *, decoding: Decoding, random: np.random.Generator
) -> Floats:
    """One action of a mixture.

    Args:
        log_weights: (K,) of the components.
        means: (K, D) normalised.
        decoding: How to choose.
        random: Used by `sample` only.

    Returns:
        (D,) normalised.
    """
    if decoding == "most-likely":
        return means[int(np.argmax(log_weights))]
    weights = np.exp(log_weights.astype(np.float64))
    drawn = int(random.choice(len(weights), p=weights / weights.sum()))
    noise = random.normal(0.0, LOW_NOISE_STD, size=means.shape[1])
    return (means[drawn] + noise).astype(np.float32)


def closed_probability(action: Floats, grasp_logit: float | None) -> float:
    """How sure the network is that the gripper should be closed.

    Args:
        action: (6,) or (7,) normalised; a seventh number is the grasp.
        grasp_logit: Log-odds, where the network has them.
    """
    if grasp_logit is None:
        return denormalise_grasp(float(action[POSE_DIMS]))
    # tanh does not overflow, unlike exp.
    return 0.5 * (1.0 + math.tanh(0.5 * grasp_logit))


def decide_grasp(probability: float, *, closed: bool, hysteresis: GraspHysteresis) -> bool:
    """Whether to close; between the thresholds it stays as it is."""
    if closed:
        return probability >= hysteresis.open_below
    return probability > hysteresis.close_above
