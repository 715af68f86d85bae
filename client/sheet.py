"""A contact sheet of an episode: left and right images over time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from common.datasets import Episode
from common.errors import MissingExtra, NotWritable

COLUMNS = 8
LARGEST_ROWS = 4
"""Pairs below each other: 32 moments are enough to see what happens."""
_LINE_PX = 14
_GAP_PX = 2


def write_sheet(episode: Episode, path: Path, *, rate_hz: float) -> int:
    """Draw moments of an episode, evenly spread over its time, each a left above a right image.

    Args:
        episode: With a column of images.
        path: PNG file to write.
        rate_hz: Rows per second.

    Returns:
        How many moments are on it.

    Raises:
        MissingExtra: Pillow is not installed.
        NotWritable: The file cannot be written.
    """
    try:
        from PIL import Image, ImageDraw
    except ModuleNotFoundError as error:
        raise MissingExtra("pillow", "control") from error
    count = min(len(episode), COLUMNS * LARGEST_ROWS)
    rows = np.linspace(0, len(episode) - 1, count).round().astype(int).tolist()
    images = episode["images"]
    height, width = images.shape[2:]
    step_x, step_y = width + _GAP_PX, 2 * (height + _GAP_PX) + _LINE_PX
    lines = -(-count // COLUMNS)
    sheet = Image.new("L", (min(count, COLUMNS) * step_x, lines * step_y), 255)
    draw = ImageDraw.Draw(sheet)
    for place, row in enumerate(rows):
        x, y = place % COLUMNS * step_x, place // COLUMNS * step_y
        draw.text((x + 2, y + 1), f"{row / rate_hz:.1f} s  row {row}", fill=0)
        for eye in range(2):
            box = (x, y + _LINE_PX + eye * (height + _GAP_PX))
            sheet.paste(Image.fromarray(np.ascontiguousarray(images[row, eye])), box)
    try:
        sheet.save(path, format="PNG")
    except OSError as error:
        raise NotWritable(str(path), error.strerror or str(error)) from error
    return count
