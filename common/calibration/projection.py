"""How the angle to the optical axis becomes a distance from the principal point, and back.

Both lenses are radially symmetric: a ray at angle theta [rad] to the axis meets the image at
distance r [px] from the principal point.

Only operations that round the same on every processor (+, -, *, /, square root) and the C library's
scalar sine and cosine are used on the way from pixel to ray, so that every process gets the same
bits.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

import numpy as np
from annotated_types import Gt, Len, Lt
from pydantic import BaseModel, ConfigDict, model_validator

from common.se3 import Array

_CONFIG = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

_NEWTON_STEPS = 40
_CONVERGED_RAD = 1e-14
_BEYOND_CIRCLE_RAD = math.radians(5.0)
"""The curve must rise a little past the image circle: grids interpolate across its border."""


class Pinhole(BaseModel):
    """Ideal lens without distortion: r = f tan(theta), with f from the vertical field of view."""

    model_config = _CONFIG

    kind: Literal["pinhole"]
    fovy_deg: Annotated[float, Gt(0), Lt(179)]

    def focal_px(self, height: int) -> float:
        """Focal length f = (height / 2) / tan(fovy / 2) [px]."""
        return 0.5 * height / math.tan(math.radians(self.fovy_deg) / 2.0)

    def sine_cosine(self, radius_px: Array, *, height: int) -> tuple[Array, Array]:
        """sin(theta) and cos(theta) of the rays at these distances from the principal point."""
        tangent = radius_px / self.focal_px(height)
        cosine = 1.0 / np.sqrt(1.0 + tangent * tangent)
        return tangent * cosine, cosine

    def radius_px(self, theta_rad: Array, *, height: int) -> Array:
        """Distance r = f tan(theta) [px]; infinite at or behind the image plane."""
        in_front = theta_rad < math.pi / 2.0
        tangent = np.tan(np.where(in_front, theta_rad, 0.0))
        return np.where(in_front, self.focal_px(height) * tangent, np.inf)

    def circle_px(self) -> float:
        """Radius of the image circle [px]: a pinhole has none."""
        return math.inf


class KannalaBrandt(BaseModel):
    """Fisheye lens: r = f (theta + k1 theta^3 + k2 theta^5 + k3 theta^7 + k4 theta^9).

    Source: J. Kannala, S. Brandt, "A generic camera model and calibration method for conventional,
    wide-angle, and fish-eye lenses", IEEE TPAMI 28(8), 2006.
    """

    model_config = _CONFIG

    kind: Literal["kannala_brandt"]
    focal: Annotated[float, Gt(0)]
    """f [px]."""
    k: Annotated[tuple[float, ...], Len(4, 4)]
    max_angle_deg: Annotated[float, Gt(0), Lt(175)]
    """Edge of the image circle: pixels that look further out are black."""

    @model_validator(mode="after")
    def _rises(self) -> Self:
        theta = np.linspace(0.0, math.radians(self.max_angle_deg) + _BEYOND_CIRCLE_RAD, 512)
        if not bool((self._slope(theta) > 0.0).all()):
            raise ValueError("k: r(theta) must rise up to 5 deg past max_angle_deg")
        return self

    def _value(self, theta: Array) -> Array:
        k1, k2, k3, k4 = self.k
        t = theta * theta
        return theta * (1.0 + t * (k1 + t * (k2 + t * (k3 + t * k4))))

    def _slope(self, theta: Array) -> Array:
        k1, k2, k3, k4 = self.k
        t = theta * theta
        return 1.0 + t * (3.0 * k1 + t * (5.0 * k2 + t * (7.0 * k3 + t * 9.0 * k4)))

    def theta_rad(self, radius_px: Array) -> Array:
        """Angle to the axis by Newton's method; past the image circle's rim the rim's angle."""
        limit = math.radians(self.max_angle_deg) + _BEYOND_CIRCLE_RAD
        target = np.minimum(radius_px / self.focal, self._value(np.array(limit)))
        theta = np.minimum(target, limit)
        for _ in range(_NEWTON_STEPS):
            step = (self._value(theta) - target) / self._slope(theta)
            theta = np.clip(theta - step, 0.0, limit)
            if float(np.abs(step).max(initial=0.0)) < _CONVERGED_RAD:
                break
        return theta

    def sine_cosine(self, radius_px: Array, *, height: int) -> tuple[Array, Array]:
        """sin(theta) and cos(theta) of the rays at these distances from the principal point."""
        del height  # the focal length is given in pixels
        theta = self.theta_rad(radius_px)
        flat: list[float] = theta.ravel().tolist()
        sine = np.array([math.sin(angle) for angle in flat]).reshape(theta.shape)
        cosine = np.array([math.cos(angle) for angle in flat]).reshape(theta.shape)
        return sine, cosine

    def radius_px(self, theta_rad: Array, *, height: int) -> Array:
        """Distance r(theta) [px]; infinite past the rim of the image circle."""
        del height
        limit = math.radians(self.max_angle_deg) + _BEYOND_CIRCLE_RAD
        value = self.focal * self._value(np.minimum(theta_rad, limit))
        return np.where(theta_rad <= limit, value, np.inf)

    def circle_px(self) -> float:
        """Radius of the image circle [px]."""
        return float(self.focal * self._value(np.array(math.radians(self.max_angle_deg))))
