"""One eye of the policy: image -> feature map -> key points -> features."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from services.policy.learning.config import EncoderConfig
from services.policy.learning.resnet import ResNet18
from services.policy.learning.spatial_softmax import SpatialSoftmax


class Encoder(nn.Module):
    """ResNet18, 1x1 convolution to key points, spatial softmax, linear layer, ReLU."""

    def __init__(self, config: EncoderConfig) -> None:
        super().__init__()
        values = 2 * config.keypoints
        self.fold = nn.PixelUnshuffle(config.fold) if config.fold > 1 else nn.Identity()
        self.resnet = ResNet18(
            inputs=config.fold**2,
            width=config.width,
            stages=config.stages,
            blocks=config.blocks,
            halving_stages=config.halving_stages,
        )
        self.keypoints = nn.Conv2d(self.resnet.channels, config.keypoints, 1)
        self.softmax = SpatialSoftmax(map_px=config.map_px)
        # Expected positions lie close to the middle at first; normalised they carry signal.
        self.norm = nn.BatchNorm1d(values) if config.keypoint_batchnorm else nn.Identity()
        self.linear = nn.Linear(values, config.features)

    def forward(self, images: Tensor) -> Tensor:
        """(B, 1, H, W) in [0, 1] -> (B, features)."""
        points = self.softmax(self.keypoints(self.resnet(self.fold(images))))
        return torch.relu(self.linear(self.norm(points)))
