"""`reduce_images` for tensors on any device."""

from __future__ import annotations

import torch

from services.policy.learning.images import halves


def reduce_images_torch(images: torch.Tensor, *, input_px: int) -> torch.Tensor:
    """Images as a network sees them, (..., 128, 128) uint8; the twin of `reduce_images`.

    Raises:
        InvalidValue: Another size.
    """
    if not halves(tuple(images.shape), input_px):
        return images
    wide = images.to(torch.int16)
    rows = wide[..., 0::2, :] + wide[..., 1::2, :]
    total = rows[..., 0::2] + rows[..., 1::2]
    return ((total + 2) >> 2).to(torch.uint8)
