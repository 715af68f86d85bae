"""Key points of a feature map.

p_c(i, j) = exp(f_c(i, j)) / sum exp(f_c);  (x_c, y_c) = sum p_c(i, j) (x_j, y_i)

with the pixel grid x, y in [-1, 1]. Source: Finn et al. 2016; temperature 1.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn


class SpatialSoftmax(nn.Module):
    """Where each channel of a map looks.

    Args:
        map_px: Side of the square map.
    """

    def __init__(self, *, map_px: int) -> None:
        super().__init__()
        axis = torch.linspace(-1.0, 1.0, map_px)
        y, x = torch.meshgrid(axis, axis, indexing="ij")
        self.grid: Tensor
        self.register_buffer("grid", torch.stack([x.flatten(), y.flatten()], -1), persistent=False)

    def forward(self, maps: Tensor) -> Tensor:
        """(B, C, H, W) -> (B, 2 C) as x_0, y_0, x_1, ...; float32 also under autocast."""
        share = torch.softmax(maps.flatten(2).float(), dim=-1)
        # A product and a sum: a matrix product would be rounded to bfloat16 under autocast.
        points = (share[..., None] * self.grid).sum(dim=-2)
        return points.flatten(1)
