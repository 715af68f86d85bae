"""What surfaces look like: albedo from the model's colours, checkers by geom name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import mujoco
import numpy as np
import numpy.typing as npt

from common.se3 import Array

Integers: TypeAlias = npt.NDArray[np.int32]


@dataclass(frozen=True)
class Checker:
    """Squares of two tones on the horizontal top faces of geoms whose name starts with `prefix`.

    The pattern lies in the world's x-y plane, so it suits things that stand still.

    Args:
        prefix: Start of the geom's name.
        square_m: Edge of a square.
        dark: Albedo of the dark squares over that of the light ones.
    """

    prefix: str
    square_m: float
    dark: float


CHECKERS = (Checker("floor", 0.25, 0.75), Checker("table", 0.10, 0.85))

_GRAY_OF_RGB = (0.299, 0.587, 0.114)
_UNSET_RGBA = (0.5, 0.5, 0.5, 1.0)
_TOP_FACE = 0.9999
"""World z of the normal above which a face counts as horizontal."""


class Surfaces:
    """Colours and checkers of all geoms of one model.

    The surface of a hit is its geom id, or geom id + ngeom on a checkered top face, or -1 where
    nothing was met. `rgb` and `gray` are indexed by surface (their last row is black, for -1).
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self._ngeom = int(model.ngeom)
        rgb = np.array([_color(model, geom) for geom in range(model.ngeom)]).reshape(-1, 3)
        self.rgb: Array = np.vstack([rgb, rgb, np.zeros((1, 3))])
        self.gray: Array = sum(
            (weight * self.rgb[:, k] for k, weight in enumerate(_GRAY_OF_RGB)),
            np.zeros(len(self.rgb)),
        )
        names = [str(model.geom(geom).name) for geom in range(model.ngeom)]
        pattern = [_checker_of(name) for name in names]
        self._top_shift: Integers = np.array(
            [0 if checker is None else model.ngeom for checker in pattern] + [0], dtype=np.int32
        )
        tops = [checker or Checker("", 1.0, 1.0) for checker in pattern]
        plain = [Checker("", 1.0, 1.0)]
        rows = plain * model.ngeom + tops + plain
        self._per_m = np.array([1.0 / checker.square_m for checker in rows])
        self._mean = np.array([0.5 * (1.0 + checker.dark) for checker in rows])
        self._half = np.array([0.5 * (1.0 - checker.dark) for checker in rows])

    def surface(self, geom: Integers, normal_z: Array) -> Integers:
        """(n,) surfaces of hits: geom ids (n,) and world z of the normals (n,)."""
        return geom + self._top_shift[geom] * (normal_z > _TOP_FACE)

    def is_checkered(self, surface: Integers) -> npt.NDArray[np.bool_]:
        """Where a surface has a checker."""
        return surface >= self._ngeom

    def tone(self, surface: Integers, x: Array, y: Array, spacing_m: Array) -> Array:
        """Brightness of the pattern: 1 on light squares and plain surfaces, `dark` on dark ones.

        It fades to the mean of both where a square spans less than four rays, and is gone at two:
        finer squares than the picture can show would only make moire.

        Args:
            surface: (n,) surfaces.
            x: (n,) hit points in the world [m].
            y: (n,) hit points in the world [m].
            spacing_m: (n,) distance between neighbouring rays on the surface.
        """
        per_m = self._per_m[surface]
        squares = np.floor(x * per_m) + np.floor(y * per_m)
        sign = 1.0 - 2.0 * np.abs(squares - 2.0 * np.floor(0.5 * squares))
        sharpness = np.clip(2.0 - (4.0 * spacing_m) * per_m, 0.0, 1.0)
        return self._mean[surface] + self._half[surface] * sharpness * sign


def _checker_of(name: str) -> Checker | None:
    """The checker for a geom of this name, if any."""
    return next((checker for checker in CHECKERS if name.startswith(checker.prefix)), None)


def _color(model: mujoco.MjModel, geom: int) -> list[float]:
    """A geom's own colour, or its material's where it has none of its own."""
    rgba: list[float] = model.geom_rgba[geom].tolist()
    material = int(model.geom_matid[geom])
    if material >= 0 and tuple(rgba) == _UNSET_RGBA:
        rgba = model.mat_rgba[material].tolist()
    return rgba[:3]
