"""Camera images at the size that a network sees; one function for training and deployment.

out[i, j] = floor((I[2i, 2j] + I[2i, 2j+1] + I[2i+1, 2j] + I[2i+1, 2j+1] + 2) / 4)

Integers, so that NumPy and torch (`images_torch.py`) give the same bytes.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from common.errors import InvalidValue

CAMERA_PX = 128
"""Side of a camera image."""

Images = npt.NDArray[np.uint8]


def halves(shape: tuple[int, ...], input_px: int) -> bool:
    """True when images of a shape are to be reduced, False when they stay.

    Raises:
        InvalidValue: Another size.
    """
    if len(shape) < 2 or shape[-2:] != (CAMERA_PX, CAMERA_PX):
        raise InvalidValue("images", list(shape), f"shape (..., {CAMERA_PX}, {CAMERA_PX})")
    if input_px not in (CAMERA_PX, CAMERA_PX // 2):
        raise InvalidValue("input_px", input_px, f"{CAMERA_PX // 2} or {CAMERA_PX}")
    return input_px != CAMERA_PX


def reduce_images(images: Images, *, input_px: int) -> Images:
    """Images as a network sees them.

    Args:
        images: (..., 128, 128) uint8.
        input_px: 128 for the images themselves, 64 for their 2x2 means.

    Raises:
        InvalidValue: Another size.
    """
    if not halves(images.shape, input_px):
        return images
    wide = images.astype(np.uint16)
    rows = wide[..., 0::2, :] + wide[..., 1::2, :]
    total = rows[..., 0::2] + rows[..., 1::2]
    return ((total + 2) >> 2).astype(np.uint8)
