"""Networks on torch: the reference, and the way to a GPU. Needs torch (extra `train`)."""

from __future__ import annotations

import torch

from services.policy.learning.checkpoint import Checkpoint
from services.policy.learning.checkpoint_weights import load_network
from services.policy.learning.device import find_device
from services.policy.learning.network import PolicyOutput, RecurrentState
from services.policy.serving.backend import (
    ROWS,
    Floats,
    StepInput,
    StepOutput,
    join_outputs,
    pad_rows,
)


class TorchBackend:
    """The network of a checkpoint.

    On a CPU each cell is a pass of its own, on a GPU every pass has `ROWS` cells: in both cases
    the size of a pass does not depend on who shares the step.

    Args:
        checkpoint: Whose network.
        device: `cpu`, `cuda` or `cuda:<number>`.

    Raises:
        DamagedCheckpoint: The weights cannot be read.
        NoSuchDevice: The device is not there.
        ShapesDiffer: The weights are another network's.
    """

    def __init__(self, checkpoint: Checkpoint, *, device: str = "cpu") -> None:
        self._device = find_device(device)
        self.runtime = f"torch {torch.__version__}"
        self.device = device
        self._network = load_network(checkpoint).to(self._device)
        self._rows = 1 if self._device.type == "cpu" else ROWS

    def run(self, given: StepInput) -> StepOutput:
        """One step of any number of cells."""
        starts = range(0, len(given.images), self._rows)
        return join_outputs([self._pass(given.part(slice(at, at + self._rows))) for at in starts])

    def _pass(self, given: StepInput) -> StepOutput:
        cells, rows = len(given.images), self._rows
        images = torch.zeros((rows, *given.images.shape[1:]), dtype=torch.uint8)
        images[:cells] = torch.from_numpy(given.images)
        history = torch.from_numpy(pad_rows(given.history, rows=rows, axis=0))
        state = (self._send(given.h), self._send(given.c))
        # Full float32 and the same algorithm each time, also on a GPU.
        exact = torch.backends.cudnn.flags(deterministic=True, benchmark=False, allow_tf32=False)
        with torch.inference_mode(), exact:
            output, after = self._network.step(
                images.to(self._device), history.to(self._device), state
            )
        return _fetch(output, after, cells)

    def _send(self, state: Floats) -> torch.Tensor:
        padded = pad_rows(state, rows=self._rows, axis=1)
        return torch.from_numpy(padded).contiguous().to(self._device)


def _fetch(output: PolicyOutput, after: RecurrentState, cells: int) -> StepOutput:
    logit, (h, c) = output.grasp_logit, after
    return StepOutput(
        log_weights=output.mixture.log_weights[:cells].cpu().numpy(),
        means=output.mixture.means[:cells].cpu().numpy(),
        grasp_logit=None if logit is None else logit[:cells].cpu().numpy(),
        h=h[:, :cells].cpu().numpy(),
        c=c[:, :cells].cpu().numpy(),
    )
