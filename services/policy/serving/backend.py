"""What runs a network: one step for several cells."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from services.policy.learning.config import NetworkConfig
from services.policy.learning.images import Images
from services.policy.learning.onnx_signature import POSE_DIMS

Floats: TypeAlias = npt.NDArray[np.float32]

ROWS = 8
"""Rows of a full dense pass. A library may choose the order in which it sums a matrix product by
its number of rows (torch on a CPU does), and an observation would get other bits in other company.
So a pass has this many rows, or a number that was found to give the same bits."""


@dataclass(frozen=True)
class StepInput:
    """What the network is given for one step of n cells.

    Args:
        images: (n, 2, px, px) uint8, left eye first.
        history: (n, history steps, 6) previous actions, normalised, oldest first.
        h: (layers, n, width) state of the LSTM.
        c: (layers, n, width) its memory.
    """

    images: Images
    history: Floats
    h: Floats
    c: Floats

    @classmethod
    def blank(cls, config: NetworkConfig, *, cells: int) -> StepInput:
        """Black images and zeros, to warm up with."""
        px, state = config.encoder.input_px, (config.lstm.layers, cells, config.lstm.width)
        return cls(
            images=np.zeros((cells, 2, px, px), dtype=np.uint8),
            history=np.zeros((cells, config.history.steps, POSE_DIMS), dtype=np.float32),
            h=np.zeros(state, dtype=np.float32),
            c=np.zeros(state, dtype=np.float32),
        )

    def part(self, cells: slice) -> StepInput:
        """Some of the cells."""
        return StepInput(
            self.images[cells], self.history[cells], self.h[:, cells], self.c[:, cells]
        )


@dataclass(frozen=True)
class StepOutput:
    """What the network says about one step of n cells.

    Args:
        log_weights: (n, K) of the mixture's components.
        means: (n, K, 6 or 7) normalised actions; the seventh is the grasp.
        grasp_logit: (n,) log-odds of a closed gripper, or None where the mixture has the grasp.
        h: (layers, n, width) state after the step.
        c: (layers, n, width) memory after it.
    """

    log_weights: Floats
    means: Floats
    grasp_logit: Floats | None
    h: Floats
    c: Floats


class Backend(Protocol):
    """A network, loaded and ready.

    A cell's output has the same bits whichever cells share the step, and in whichever order.
    """

    runtime: str
    """Library and version, for the record."""
    device: str

    def run(self, given: StepInput) -> StepOutput:
        """One step of any number of cells."""
        ...


def join_outputs(parts: list[StepOutput]) -> StepOutput:
    """Outputs of consecutive cells as one."""
    if len(parts) == 1:
        return parts[0]
    logits = [part.grasp_logit for part in parts if part.grasp_logit is not None]
    return StepOutput(
        log_weights=np.concatenate([part.log_weights for part in parts]),
        means=np.concatenate([part.means for part in parts]),
        grasp_logit=np.concatenate(logits) if logits else None,
        h=np.concatenate([part.h for part in parts], axis=1),
        c=np.concatenate([part.c for part in parts], axis=1),
    )


def pad_rows(values: Floats, *, rows: int, axis: int) -> Floats:
    """Zeros behind the cells of an array, up to a number of rows."""
    missing = rows - values.shape[axis]
    if missing == 0:
        return values
    widths = [(0, missing if each == axis else 0) for each in range(values.ndim)]
    return np.pad(values, widths)
