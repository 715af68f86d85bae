"""What goes into the exported graph and what comes out; needs neither torch nor ONNX."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

from services.policy.learning.config import NetworkConfig

EYES = 2
POSE_DIMS = 6

Shape: TypeAlias = tuple[int | str, ...]
"""Lengths, with names for those that are free."""


def action_dims(config: NetworkConfig) -> int:
    """Numbers of an action: the pose, and the grasp where the mixture has it."""
    return POSE_DIMS if config.head == "separate-grasp" else POSE_DIMS + 1


def input_shapes(config: NetworkConfig) -> Mapping[str, Shape]:
    """Inputs by name: uint8 `images`, int64 `rows`, float32 the others.

    `rows` says which image each row is of; `h` and `c` are the LSTM's state before the step.
    """
    px, lstm = config.encoder.input_px, config.lstm
    shapes: dict[str, Shape] = {
        "images": ("images", EYES, px, px),
        "rows": ("rows",),
        "h": (lstm.layers, "rows", lstm.width),
        "c": (lstm.layers, "rows", lstm.width),
    }
    if config.history.steps:
        shapes["history"] = ("rows", config.history.steps, POSE_DIMS)
    return shapes


def output_shapes(config: NetworkConfig) -> Mapping[str, Shape]:
    """Outputs by name, all float32: the mixture, the grasp's log-odds, the state after the step."""
    lstm, modes = config.lstm, config.mixture.modes
    shapes: dict[str, Shape] = {
        "log_weights": ("rows", modes),
        "means": ("rows", modes, action_dims(config)),
        "h_after": (lstm.layers, "rows", lstm.width),
        "c_after": (lstm.layers, "rows", lstm.width),
    }
    if config.head == "separate-grasp":
        shapes["grasp_logit"] = ("rows",)
    return shapes
