"""Where the network is trained, and with whom."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import timedelta

import torch
import torch.distributed as dist

from services.policy.learning.device import find_device

_PATIENCE = timedelta(days=1)
"""How long processes wait for rank 0, which validates, evaluates and writes alone. That one of them
has died torchrun sees."""


@dataclass(frozen=True)
class Placement:
    """This process among those that train together.

    Args:
        device: Of the network.
        rank: From 0; rank 0 writes files.
        world_size: 1 without torchrun.
    """

    device: torch.device
    rank: int = 0
    world_size: int = 1

    @property
    def leads(self) -> bool:
        """Whether this process writes and shows."""
        return self.rank == 0

    def agree(self, stops: bool) -> bool:
        """Whether any process stops; then all do, for they wait for each other in every update."""
        return self.mean([float(stops)])[0] > 0.0

    def mean(self, values: Sequence[float]) -> list[float]:
        """Mean of each value over the processes; each of them waits for all."""
        if self.world_size == 1:
            return list(values)
        total = torch.tensor(values, dtype=torch.float64, device=self.device)
        dist.all_reduce(total)
        return (total / self.world_size).tolist()


def leads() -> bool:
    """Whether this process is the first under torchrun, or the only one."""
    return int(os.environ.get("RANK", 0)) == 0


def place(name: str) -> Placement:
    """The placement that a device name means; under torchrun a process group is opened.

    Args:
        name: `auto` (CUDA where there is one), `cpu`, `cuda` or `cuda:1`.

    Raises:
        NoSuchDevice: It is not there.
    """
    rank, world_size = int(os.environ.get("RANK", 0)), int(os.environ.get("WORLD_SIZE", 1))
    device = _choose(name, int(os.environ.get("LOCAL_RANK", 0)))
    if world_size > 1 and not dist.is_initialized():
        backend = "nccl" if device.type == "cuda" else "gloo"
        dist.init_process_group(backend, timeout=_PATIENCE)
    return Placement(device, rank, world_size)


def leave() -> None:
    """Close the process group if there is one."""
    if dist.is_initialized():
        dist.destroy_process_group()


def _choose(name: str, local_rank: int) -> torch.device:
    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "cpu"
    return find_device(f"cuda:{local_rank}" if name == "cuda" else name)
