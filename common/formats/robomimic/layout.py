"""What is where in the file, and how actions are coded.

    data                      attributes: total, env_args; of LEGATO: see below
      demo_0                  attributes: num_samples, legato_episode
        actions               (n, 7) f32 in [-1, 1]
        rewards, dones        (n,)
        obs/left_gray, obs/right_gray          (n, height, width, channels) u8
        obs/delta_positions, delta_eulers, delta_quaternions   the last two executed actions
        obs/<column>          (n, k) f32, what a robot would measure too
        legato/<column>       every column but the images, as it is in the data set
    mask/train, mask/valid    names of demos; mask/failed where there are failed ones

robomimic (BC, Gaussian and GMM alike) puts means through tanh, so actions have to lie in [-1, 1]:
`action = action_scale * stored + action_offset`, both being attributes of `data`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from common.formats.labels import Floats

LEFT, RIGHT = "left_gray", "right_gray"
COLUMNS = "legato"
SPEC_ATTRIBUTE = "legato_dataset"
EPISODE_ATTRIBUTE = "legato_episode"
SCALE_ATTRIBUTE, OFFSET_ATTRIBUTE = "action_scale", "action_offset"
ACTION_DIMENSIONS = 7

_BLOCKS = (slice(0, 3), slice(3, 6))


@dataclass(frozen=True)
class ActionCoding:
    """action = scale * stored + offset.

    Args:
        scale: (7,) powers of two: dividing by them rounds nothing.
        offset: (7,).
    """

    scale: Floats
    offset: Floats

    @classmethod
    def fit(cls, labels: Iterable[Floats]) -> Self:
        """The coding for these (n, 7) labels.

        Metres share one scale and radians another, so that directions stay what they are: the
        least power of two that no value exceeds. Grasp 0 and 1 become -1 and 1.
        """
        largest = np.zeros(2)
        for part in labels:
            found = [np.abs(part[:, block]).max() for block in _BLOCKS]
            largest = np.maximum(largest, found)
        safe = np.where(largest > 0.0, largest, 1.0)
        metres, radians = np.exp2(np.ceil(np.log2(safe)))
        scale = np.array([metres] * 3 + [radians] * 3 + [0.5])
        return cls(scale, np.array([0.0] * 6 + [0.5]))

    def encode(self, labels: Floats) -> npt.NDArray[np.float32]:
        """(n, 7) as stored; the rounding to float32 is all that is lost."""
        return ((labels - self.offset) / self.scale).astype(np.float32)
