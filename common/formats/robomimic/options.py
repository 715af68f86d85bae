"""What has to be said about a file that does not say it itself."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, Literal

from common.formats.robomimic.layout import LEFT, RIGHT

Rotations = Literal["vector", "rpy"]


@dataclass(frozen=True, kw_only=True)
class ImportOptions:
    """How to read a file that LEGATO did not write.

    Args:
        task: What is demonstrated.
        robot: What carries the gripper.
        camera: Calibration of the stereo camera.
        rate_hz: Rows per second.
        rotations: Of the actions: rotation vectors, or roll-pitch-yaw about fixed x, y, z.
        metres: Metres per unit of the translations.
        radians: Radians per unit of the rotations.
        left: Name of the left eye's images.
        right: Name of the right eye's images.
        mirrored: The images are mirrored left-right.
        keep_idle: Keep the frames at the start in which nothing is done yet.
    """

    task: str | None = None
    robot: str | None = None
    camera: str = "t265"
    rate_hz: float = 10.0
    rotations: Rotations | None = None
    metres: float = 1.0
    radians: float = 1.0
    left: str = LEFT
    right: str = RIGHT
    mirrored: bool = False
    keep_idle: bool = False

    def given(self) -> dict[str, Any]:
        """What differs from the defaults."""
        return {
            field.name: getattr(self, field.name)
            for field in dataclasses.fields(self)
            if getattr(self, field.name) != field.default
        }
