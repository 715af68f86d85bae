"""What a real sensor adds to a picture: exposure, vignetting and noise, drawn from a seed.

A frame's bytes depend on the clean picture, the episode's seed and the frame's step only, never on
what was drawn before. Exposure and vignetting stay the same over an episode, noise is new in every
frame:

    shown = clip(gain (1 - strength (r / R)^2) clean + std n), n ~ N(0, 1) per pixel,

with r the distance to the principal point and R that of the farthest pixel inside the image circle.
Pixels outside the circle stay 0.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
import numpy.typing as npt
from annotated_types import Ge, Gt, Le
from pydantic import BaseModel, ConfigDict, model_validator

from common.calibration import StereoCalibration
from common.errors import InvalidValue

_EPISODE, _FRAME = 1, 2
"""Keys of the two random streams, so that they never share numbers."""


class CameraNoise(BaseModel):
    """How much the pictures vary; as built, not at all.

    Ranges are from, to; both ends the same: no variation.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    noise_std: Annotated[float, Ge(0), Le(64)] = 0.0
    """Standard deviation of the pixel noise [grey levels]."""
    exposure_gain: tuple[Annotated[float, Gt(0), Le(4)], Annotated[float, Gt(0), Le(4)]] = (
        1.0,
        1.0,
    )
    """Factor on the bytes."""
    vignette_strength: tuple[Annotated[float, Ge(0), Le(1)], Annotated[float, Ge(0), Le(1)]] = (
        0.0,
        0.0,
    )
    """Share of the light that is missing at the rim."""

    @model_validator(mode="after")
    def _ranges_rise(self) -> CameraNoise:
        for field in ("exposure_gain", "vignette_strength"):
            low, high = getattr(self, field)
            if low > high:
                raise ValueError(f"{field}: must be from the lower to the higher value")
        return self

    @property
    def is_off(self) -> bool:
        """Whether pictures stay as they are."""
        return self == CameraNoise()


RANDOMISED = CameraNoise(noise_std=3.0, exposure_gain=(0.8, 1.2), vignette_strength=(0.0, 0.4))
"""A choice for training pictures; chosen by judgement, not measured on cameras."""


class Sensor:
    """The sensors of one stereo pair in one episode.

    Args:
        calibration: Of the camera whose pictures are changed.
        noise: How much.
        seed: Of the episode, not negative.

    Raises:
        InvalidValue: A negative seed.
    """

    def __init__(self, calibration: StereoCalibration, noise: CameraNoise, *, seed: int) -> None:
        if seed < 0:
            raise InvalidValue("seed", seed, "at least 0")
        self._noise = noise
        self._seed = seed
        self._shape = (2, calibration.height, calibration.width)
        self._inside = ~calibration.outside_circle()
        random = np.random.default_rng([seed, _EPISODE])
        gain = random.uniform(*noise.exposure_gain)
        strength = random.uniform(*noise.vignette_strength)
        self._gain = (gain * (1.0 - strength * self._rim(calibration))).astype(np.float32)

    def expose(self, left: bytes, right: bytes, *, step: int) -> tuple[bytes, bytes]:
        """Change a pair of pictures.

        Args:
            left: As `StereoCamera.render` gives it.
            right: As `StereoCamera.render` gives it.
            step: Of the frame, not negative.

        Raises:
            InvalidValue: A picture of another size, or a negative step.
        """
        size = self._shape[1] * self._shape[2]
        for side, picture in (("left", left), ("right", right)):
            if len(picture) != size:
                raise InvalidValue(side, f"{len(picture)} bytes", f"{size} bytes")
        if step < 0:
            raise InvalidValue("step", step, "at least 0")
        if self._noise.is_off:
            return left, right
        clean = np.frombuffer(left + right, dtype=np.uint8).reshape(self._shape)
        light = clean * self._gain
        if self._noise.noise_std > 0.0:
            random = np.random.default_rng([self._seed, _FRAME, step])
            noise = random.standard_normal(self._shape, dtype=np.float32)
            light += np.float32(self._noise.noise_std) * noise
        shown = np.clip(np.rint(light), 0.0, 255.0).astype(np.uint8)
        shown *= self._inside
        return shown[0].tobytes(), shown[1].tobytes()

    def _rim(self, calibration: StereoCalibration) -> npt.NDArray[np.float64]:
        """(height, width) (r / R)^2."""
        u, v = calibration.center_px
        x, y = np.arange(calibration.width) + 0.5 - u, np.arange(calibration.height) + 0.5 - v
        square = x[None, :] ** 2 + y[:, None] ** 2
        return square / square[self._inside].max(initial=1.0)
