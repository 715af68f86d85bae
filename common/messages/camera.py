from __future__ import annotations

from typing import Annotated, Self

from annotated_types import Ge, Le
from pydantic import model_validator

from common.messages.base import Message, Name


class StereoFrame(Message):
    """A stereo pair of grayscale images from the gripper's camera, rows top-down, upright."""

    camera: Name
    """Calibration the pair was made with."""
    width: Annotated[int, Ge(1), Le(2048)]
    height: Annotated[int, Ge(1), Le(2048)]
    left: bytes
    """width × height bytes, row by row; the left eye is at tool +y."""
    right: bytes
    due_step: Annotated[int, Ge(-1)]
    """Lockstep: the tick at which the action computed from this frame takes effect, else -1."""

    @model_validator(mode="after")
    def _exact_length(self) -> Self:
        expected = self.width * self.height
        for eye, pixels in (("left", self.left), ("right", self.right)):
            if len(pixels) != expected:
                raise ValueError(f"{eye} image has {len(pixels)} bytes, expected {expected}")
        return self
