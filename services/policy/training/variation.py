"""How the images of a window are varied: moved and changed in gray level, in one pass over memory.

out[i, j] = clip(floor((k I[clip(i - down), clip(j - right)] + 64) / 128) + d, 0, 255)

All of it fits 16 bits, so that one instruction does many pixels and every machine gives the same
bytes. A table of 256 gray levels takes five times as long.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from services.policy.learning.images import CAMERA_PX, Images
from services.policy.training.config import TrainingConfig

Variations = npt.NDArray[np.int64]
"""(windows, 4) pixels down, pixels right, contrast k [1/128], brightness d [gray levels]."""

UNIT = 128
"""Contrast of an image that stays as it is."""
_HALF, _BITS = np.uint16(UNIT // 2), np.uint16(7)
_BLACK, _WHITE = np.int16(0), np.int16(255)
_MIDDLE = 127.5


def draw_variations(random: np.random.Generator, count: int, config: TrainingConfig) -> Variations:
    """How each of the windows is varied; contrast is about middle gray."""
    limits = config.augmentation
    largest = limits.shift_px // (CAMERA_PX // config.network.encoder.input_px)
    shifts = random.integers(-largest, largest + 1, size=(count, 2))
    contrast = 1.0 + limits.contrast * random.uniform(-1.0, 1.0, size=count)
    brightness = 255.0 * limits.brightness * random.uniform(-1.0, 1.0, size=count)
    factor = np.rint(UNIT * contrast)
    offset = np.rint(_MIDDLE * (1.0 - factor / UNIT) + brightness)
    return np.column_stack([shifts, factor.astype(np.int64), offset.astype(np.int64)])


# The same marks as the camera's kernels: no allocation, no threads, compiled code kept on the disk.
@njit(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True, _nrt=False)
def _repeat_edges(image: Images, px: int, rows: tuple[int, int], columns: tuple[int, int]) -> None:
    """Fill a flat image outside these rows and columns with what is nearest inside."""
    (top, bottom), (left, end) = rows, columns
    # Column by column: row by row would become a call per row, to fill two or three bytes.
    for column in range(left):
        for row in range(top, bottom):
            image[row * px + column] = image[row * px + left]
    for column in range(end, px):
        for row in range(top, bottom):
            image[row * px + column] = image[row * px + end - 1]
    for row in range(top):
        for column in range(px):
            image[row * px + column] = image[top * px + column]
    for row in range(bottom, px):
        for column in range(px):
            image[row * px + column] = image[(bottom - 1) * px + column]


@njit(cache=True, nogil=True, error_model="numpy", no_cfunc_wrapper=True, _nrt=False)
def vary(source: Images, target: Images, down: int, right: int, factor: int, offset: int) -> None:
    """Write varied images; what a shift uncovers repeats the edge.

    Args:
        source: (T, 2, px, px) C order; px is larger than the shifts.
        target: The same shape, another place.
        down: Pixels by which the images move down.
        right: Pixels by which they move to the right.
        factor: Contrast k, 0 to 256.
        offset: Brightness d, -383 to 383.
    """
    px = source.shape[3]
    flat = (source.shape[0] * source.shape[1], px * px)
    sources, targets = source.reshape(flat), target.reshape(flat)
    k, d = np.uint16(factor), np.int16(offset)
    top, bottom = max(down, 0), px + min(down, 0)
    left, end = max(right, 0), px + min(right, 0)
    # One long run of pixels is fast; the few that come from another row are mended afterwards.
    first, last, moved = top * px + left, (bottom - 1) * px + end, down * px + right
    for image in range(flat[0]):
        old, new = sources[image, first - moved : last - moved], targets[image, first:last]
        for pixel in range(new.size):
            # As ufuncs, because numba's operators would widen 16 bits to 64.
            product = np.add(np.multiply(np.uint16(old[pixel]), k), _HALF)
            level = np.add(np.int16(np.right_shift(product, _BITS)), d)
            new[pixel] = np.uint8(np.minimum(np.maximum(level, _BLACK), _WHITE))
        _repeat_edges(targets[image], px, (top, bottom), (left, end))
