"""A calibrated stereo pair: two equal lenses at known places of the tool frame."""

from __future__ import annotations

from typing import Annotated, TypeAlias

import numpy as np
import numpy.typing as npt
from annotated_types import Ge, Le
from pydantic import BaseModel, ConfigDict, Field

from common.calibration.projection import KannalaBrandt, Pinhole
from common.messages.base import Name
from common.se3 import Array

Point: TypeAlias = tuple[float, float, float]

R_TOOL_CAMERA: Array = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Camera axes in the tool frame: x right = -y, y down = -z, z forward = +x."""
R_TOOL_CAMERA.flags.writeable = False


class StereoCalibration(BaseModel):
    """Two eyes with one lens model, both looking along tool +x with tool +z up.

    Camera frame: x right, y down, z forward. Pixel (column u, row v) is a unit square whose centre
    has the image coordinates (u + 0.5, v + 0.5); row 0 is the top row.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    name: Name
    source: str
    """Where the figures come from."""
    width: Annotated[int, Ge(2), Le(2048)]
    height: Annotated[int, Ge(2), Le(2048)]
    center_px: tuple[float, float]
    """Principal point in image coordinates: column, row."""
    p_tool_left_m: Point
    p_tool_right_m: Point
    lens: Annotated[Pinhole | KannalaBrandt, Field(discriminator="kind")]

    def ray_directions(self, columns: Array, rows: Array) -> Array:
        """Where image points look: d = (sin(theta) x/r, sin(theta) y/r, cos(theta)).

        Args:
            columns: (...) image coordinates [px], right is positive.
            rows: (...) image coordinates [px], down is positive.

        Returns:
            (..., 3) unit vectors in the camera frame.
        """
        x, y = columns - self.center_px[0], rows - self.center_px[1]
        radius = np.sqrt(x * x + y * y)
        sine, cosine = self.lens.sine_cosine(radius, height=self.height)
        scale = sine / np.where(radius > 0.0, radius, 1.0)
        return np.stack([scale * x, scale * y, cosine], axis=-1)

    def pixel_directions(self) -> Array:
        """(height, width, 3) unit vectors in the camera frame through all pixel centres."""
        rows, columns = np.indices((self.height, self.width), dtype=np.float64)
        return self.ray_directions(columns + 0.5, rows + 0.5)

    def outside_circle(self) -> npt.NDArray[np.bool_]:
        """(height, width) True where the pixel centre lies outside the image circle: black."""
        x = np.arange(self.width) + 0.5 - self.center_px[0]
        y = np.arange(self.height) + 0.5 - self.center_px[1]
        return np.sqrt(x[None, :] ** 2 + y[:, None] ** 2) > self.lens.circle_px()

    def project(self, directions: Array) -> Array:
        """Where directions appear in the image: the inverse of `ray_directions`.

        Args:
            directions: (..., 3) vectors in the camera frame, any length but zero.

        Returns:
            (..., 2) column and row in image coordinates [px]; infinite or not a number where the
            lens cannot see.
        """
        x, y, z = directions[..., 0], directions[..., 1], directions[..., 2]
        across = np.sqrt(x * x + y * y)
        radius = self.lens.radius_px(np.arctan2(across, z), height=self.height)
        with np.errstate(invalid="ignore"):
            scale = radius / np.where(across > 0.0, across, 1.0)
            return np.stack([scale * x + self.center_px[0], scale * y + self.center_px[1]], axis=-1)
