"""Colour pictures of the whole scene from any viewpoint, for reports and pages."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import numpy.typing as npt

from common.errors import InvalidValue
from common.se3 import Array
from common.tasks.task import SceneCamera
from services.sim.camera.bundles import Indices, order_by_tile
from services.sim.camera.lighting import sky, to_display
from services.sim.camera.look import Look, Optics

TILE_PX = 32

_CHUNK = 1 << 15
"""Rays that are traced and lit together: few enough to stay in the processor's cache."""

_EDGE_STEP = 0.04
"""Neighbouring pixels that differ by more than this (0 to 1, any colour) are smoothed."""

_SKY_RGB = np.array([0.93, 0.98, 1.06])
_SKY_RGB.flags.writeable = False


class SceneRenderer:
    """Renders colour pictures of one size, with shadows.

    Args:
        model: The model that is looked at; its sizes and colours are read now.
        width: Of the picture [px].
        height: Of the picture [px].
        supersample: Rays per pixel along each edge; their mean is shown where a pixel differs from
            its neighbours, elsewhere one ray is enough. 2 gives smooth edges.

    Raises:
        InvalidValue: A size that is not positive.
    """

    def __init__(
        self, model: mujoco.MjModel, *, width: int, height: int, supersample: int = 1
    ) -> None:
        for field, value in (("width", width), ("height", height), ("supersample", supersample)):
            if value < 1:
                raise InvalidValue(field, value, "at least 1")
        self._model = model
        self._shape = (height, width)
        self._supersample = supersample
        self._fovy_deg = math.nan
        self._optics: Optics | None = None
        rows, columns = np.divmod(np.arange(height * width * supersample**2), width * supersample)
        self._order, self._tile = order_by_tile(columns, rows, tile_px=TILE_PX)
        self._columns, self._rows = columns[self._order], rows[self._order]
        self._pixel = (self._rows // supersample) * width + self._columns // supersample
        self._is_first = (self._rows % supersample == 0) & (self._columns % supersample == 0)

    def render(self, data: mujoco.MjData, camera: SceneCamera) -> npt.NDArray[np.uint8]:
        """Render what a camera sees.

        Args:
            data: State of the model; geom poses must be up to date (`mj_kinematics`).
            camera: Where it stands, what it looks at, and its vertical field of view.

        Returns:
            (height, width, 3) red, green, blue; rows from the top.

        Raises:
            InvalidValue: The camera stands on its target.
        """
        optics = self._optics_for(camera.fovy_deg)
        look = Look(
            optics,
            data,
            R_world_camera=_look_at(camera),
            p_world_eyes=np.array([camera.position_m]),
        )
        height, width = self._shape
        picture = np.zeros((height * width, 3))
        first = np.flatnonzero(self._is_first)
        picture[self._pixel[first]] = _colors(optics, look, first)
        uneven = _uneven(picture.reshape(height, width, 3)).ravel()
        rest = np.flatnonzero(uneven[self._pixel] & ~self._is_first)
        np.add.at(picture, self._pixel[rest], _colors(optics, look, rest))
        picture[uneven] *= 1.0 / self._supersample**2
        return to_display(picture.reshape(height, width, 3))

    def _optics_for(self, fovy_deg: float) -> Optics:
        if self._optics is None or fovy_deg != self._fovy_deg:
            self._optics = self._build_optics(fovy_deg)
            self._fovy_deg = fovy_deg
        return self._optics

    def _build_optics(self, fovy_deg: float) -> Optics:
        height, width = (self._supersample * size for size in self._shape)
        focal = 0.5 * height / math.tan(math.radians(fovy_deg) / 2.0)
        x = self._columns + (0.5 - 0.5 * width)
        y = self._rows + (0.5 - 0.5 * height)
        length = np.sqrt(x * x + y * y + focal * focal)
        return Optics(
            self._model,
            directions=np.stack([x / length, y / length, focal / length], axis=1),
            tile=self._tile,
            ray_angle_rad=1.0 / focal,
            shadows=True,
        )


def _uneven(picture: Array) -> npt.NDArray[np.bool_]:
    """(height, width) pixels that differ from a neighbour: more than one ray is worth its cost."""
    uneven = np.zeros(picture.shape[:2], dtype=np.bool_)
    across = np.abs(np.diff(picture, axis=1)).max(axis=2) > _EDGE_STEP
    down = np.abs(np.diff(picture, axis=0)).max(axis=2) > _EDGE_STEP
    uneven[:, 1:] |= across
    uneven[:, :-1] |= across
    uneven[1:] |= down
    uneven[:-1] |= down
    return uneven


def _colors(optics: Optics, look: Look, rays: Indices) -> Array:
    """(k, 3) intensities of red, green and blue, from 0 to 1, that some rays see."""
    chunks = [rays[start : start + _CHUNK] for start in range(0, len(rays), _CHUNK)]
    return np.concatenate([np.empty((0, 3)), *(_color_chunk(optics, look, c) for c in chunks)])


def _color_chunk(optics: Optics, look: Look, rays: Indices) -> Array:
    samples = look.sample(optics.select(np.zeros_like(rays), rays, eyes=1))
    surface, lit = samples.lit.surface, samples.lit
    brightness = np.where(surface < 0, sky(samples.ray_z), lit.factor * lit.tone)
    colors = optics.surfaces.rgb[surface]
    colors[surface < 0] = _SKY_RGB
    return np.clip(colors * brightness[:, None], 0.0, 1.0)


def _look_at(camera: SceneCamera) -> Array:
    """(3, 3) camera axes x right, y down, z forward in the world, with world z up in the picture.

    Raises:
        InvalidValue: The camera stands on its target.
    """
    forward = np.subtract(camera.target_m, camera.position_m)
    distance = float(np.linalg.norm(forward))
    if distance < 1e-9:
        raise InvalidValue("target_m", camera.target_m, "a point away from position_m")
    forward = forward / distance
    right = np.array([forward[1], -forward[0], 0.0])
    across = float(np.linalg.norm(right))
    # Straight up or down: the world's -y is to the right, as for a camera that looks along +x.
    right = right / across if across > 1e-9 else np.array([0.0, -1.0, 0.0])
    return np.stack([right, np.cross(forward, right), forward], axis=1)
