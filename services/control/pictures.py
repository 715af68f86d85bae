"""Pictures of key moments as PNG."""

from __future__ import annotations

import io

from PIL import Image

from common.messages import EpisodePicture

_MODES = {1: "L", 3: "RGB"}
_LEVEL = 1
"""Fast compression: a trial has several pictures and the next trial must not wait for them."""


def picture_name(picture: EpisodePicture) -> str:
    """Name under which it is kept, e.g. `grasp-scene`."""
    return f"{picture.moment}-{picture.view}"


def encode_png(picture: EpisodePicture) -> bytes:
    """The picture as the bytes of a PNG file."""
    image = Image.frombytes(
        _MODES[picture.channels], (picture.width, picture.height), picture.pixels
    )
    buffer = io.BytesIO()
    image.save(buffer, "PNG", compress_level=_LEVEL)
    return buffer.getvalue()
