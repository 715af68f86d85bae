"""Devices that networks run on, for training and for serving."""

from __future__ import annotations

import torch

from services.policy.learning.checkpoint_errors import NoSuchDevice


def find_device(name: str) -> torch.device:
    """A device by its name.

    Args:
        name: `cpu`, `cuda` (the first) or `cuda:<number>`.

    Raises:
        NoSuchDevice: It is not there.
    """
    count = torch.cuda.device_count() if torch.cuda.is_available() else 0
    available = ["cpu", *(f"cuda:{number}" for number in range(count))]
    asked = "cuda:0" if name == "cuda" else name
    if asked not in available:
        raise NoSuchDevice(name, available)
    return torch.device(asked)
