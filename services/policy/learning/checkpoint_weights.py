"""Weights of a network to and from a checkpoint. Needs torch (extra `train`)."""

from __future__ import annotations

import os
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save
from torch import Tensor

from services.policy.learning.checkpoint import WEIGHTS, Checkpoint
from services.policy.learning.checkpoint_errors import DamagedCheckpoint, ShapesDiffer
from services.policy.learning.network import PolicyNetwork


def write_weights(path: Path, network: PolicyNetwork) -> None:
    """Write a network's parameters and running means."""
    tensors = {
        # Rows first, as every reader expects them, however convolutions keep them here.
        name: tensor.detach().to("cpu").contiguous()
        for name, tensor in network.state_dict().items()
    }
    with path.open("wb") as file:
        file.write(save(tensors, metadata={"format": "pt"}))
        file.flush()
        os.fsync(file.fileno())


def load_network(checkpoint: Checkpoint) -> PolicyNetwork:
    """The network of a checkpoint, on the CPU, for inference.

    The global random generator is left as it is.

    Raises:
        DamagedCheckpoint: The weights cannot be read.
        ShapesDiffer: They are another network's.
    """
    path = checkpoint.folder / WEIGHTS
    try:
        tensors = load_file(path)
    except SafetensorError as error:
        raise DamagedCheckpoint(str(path), str(error)) from error
    with torch.random.fork_rng(devices=[]):
        network = PolicyNetwork(checkpoint.config.network)
    _check_shapes(str(path), network.state_dict(), tensors)
    network.load_state_dict(tensors)
    return network.eval()


def _check_shapes(path: str, expected: dict[str, Tensor], got: dict[str, Tensor]) -> None:
    for name in sorted(expected.keys() | got.keys()):
        wanted, found = _describe(expected.get(name)), _describe(got.get(name))
        if wanted != found:
            raise ShapesDiffer(path, name, wanted, found)


def _describe(tensor: Tensor | None) -> str:
    return "nothing" if tensor is None else f"{tensor.dtype} of {list(tensor.shape)}"
