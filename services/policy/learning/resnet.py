"""ResNet18 with free numbers of input channels, width, stages and blocks, and size of the last map.

Stem: 7x7 convolution of stride 2, 3x3 maximum of stride 2. Four stages of two blocks with w, 2w,
4w, 8w channels: y = relu(x' + bn(conv(relu(bn(conv(x)))))), x' = x, or a 1x1 convolution of it
where the shape changes. Source: He et al. 2016, table 1 and figure 5 (left).
"""

from __future__ import annotations

from torch import Tensor, nn


def _convolution(inputs: int, outputs: int, *, size: int, stride: int) -> nn.Conv2d:
    return nn.Conv2d(inputs, outputs, size, stride=stride, padding=size // 2, bias=False)


class BasicBlock(nn.Module):
    """Two 3x3 convolutions beside a shortcut."""

    def __init__(self, inputs: int, outputs: int, *, stride: int) -> None:
        super().__init__()
        self.conv1 = _convolution(inputs, outputs, size=3, stride=stride)
        self.bn1 = nn.BatchNorm2d(outputs)
        self.conv2 = _convolution(outputs, outputs, size=3, stride=1)
        self.bn2 = nn.BatchNorm2d(outputs)
        self.relu = nn.ReLU()
        self.shortcut: nn.Module = nn.Identity()
        if stride != 1 or inputs != outputs:
            projection = _convolution(inputs, outputs, size=1, stride=stride)
            self.shortcut = nn.Sequential(projection, nn.BatchNorm2d(outputs))

    def forward(self, x: Tensor) -> Tensor:
        """(B, inputs, H, W) -> (B, outputs, H / stride, W / stride)."""
        y = self.relu(self.bn1(self.conv1(x)))
        y = self.bn2(self.conv2(y))
        return self.relu(y + self.shortcut(x))


class ResNet18(nn.Module):
    """Image to feature map.

    Args:
        inputs: Channels of the image.
        width: Channels w of the first stage; each further stage doubles them.
        stages: Number of stages (4 in the original).
        blocks: Of each stage (2 in the original).
        halving_stages: How many of the stages after the first halve the map (3 in the original).
            The map has side input / 2^(2 + halving_stages).
    """

    def __init__(
        self, *, inputs: int = 1, width: int, stages: int, blocks: int = 2, halving_stages: int
    ) -> None:
        super().__init__()
        self.stem = nn.Sequential(
            _convolution(inputs, width, size=7, stride=2),
            nn.BatchNorm2d(width),
            nn.ReLU(),
            nn.MaxPool2d(3, stride=2, padding=1),
        )
        made: list[nn.Module] = []
        inputs = width
        for stage in range(stages):
            outputs = width << stage
            stride = 2 if 1 <= stage <= halving_stages else 1
            made.append(BasicBlock(inputs, outputs, stride=stride))
            made += [BasicBlock(outputs, outputs, stride=1) for _ in range(1, blocks)]
            inputs = outputs
        self.stages = nn.Sequential(*made)
        self.channels = inputs
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")

    def forward(self, images: Tensor) -> Tensor:
        """(B, inputs, H, W) in [0, 1] -> (B, channels, H', W')."""
        return self.stages(self.stem(images))
