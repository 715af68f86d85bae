"""Colour pictures of the whole scene from any viewpoint, for reports and pages."""

from __future__ import annotations

import mujoco
import numpy as np
import numpy.typing as npt

from common.errors import InvalidValue
from common.se3 import Array
from common.tasks.task import SceneCamera
from services.sim.camera.desk import PATTERN_TONE, PLAIN_LIGHT, Desk, make_desk
from services.sim.camera.kernel import render_pictures
from services.sim.camera.lens import MOST_RAYS, Lens, build_pinhole, freeze
from services.sim.camera.meshes import Skin, make_room, render_with_meshes
from services.sim.camera.shading import bytes_of_intensities
from services.sim.camera.shapes import Mask
from services.sim.camera.tables import make_scene

_EDGE_STEP = 0.04
"""Neighbouring pixels that differ by more than this (0 to 1, any colour) are smoothed."""


class SceneRenderer:
    """Renders colour pictures of one size, with shadows.

    Args:
        model: The model that is looked at; its sizes, colours and names are read now.
        width: Of the picture [px].
        height: Of the picture [px].
        supersample: Rays per pixel along each edge; their mean is shown where a pixel differs from
            its neighbours, elsewhere one ray is enough. 2 gives smooth edges.
        skin: Meshes that are shown in place of some geoms.

    Raises:
        InvalidValue: A size that is not positive.
        UnsupportedGeom: A visible geom is of a kind that cannot be drawn.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        *,
        width: int,
        height: int,
        supersample: int = 1,
        skin: Skin | None = None,
    ) -> None:
        for field, value in (("width", width), ("height", height), ("supersample", supersample)):
            if value < 1:
                raise InvalidValue(field, value, "at least 1")
        self._shape = (height, width)
        self._supersample = supersample
        self._scene = make_scene(model if skin is None else skin.uncover(model), most=MOST_RAYS)
        surfaces = self._scene.surfaces
        self._rgb = np.stack([surfaces["red"], surfaces["green"], surfaces["blue"]], axis=1)
        self._skin = skin
        if skin is not None:
            self._rgb = np.concatenate([self._rgb, skin.albedo])
            self._room = make_room(len(skin.bodies), MOST_RAYS)

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
        height, width = self._shape
        step = self._supersample
        first = np.zeros((step * height, step * width), dtype=np.bool_)
        first[::step, ::step] = True
        picture = self._trace(data, camera, first)[::step, ::step]
        uneven = _uneven(picture)
        rest = uneven.repeat(step, axis=0).repeat(step, axis=1) & ~first
        if rest.any():
            samples = self._trace(data, camera, rest)
            others = samples.reshape(height, step, width, step, 3).sum(axis=(1, 3))
            picture[uneven] = (picture[uneven] + others[uneven]) * (1.0 / step**2)
        return bytes_of_intensities(picture)

    def _trace(self, data: mujoco.MjData, camera: SceneCamera, chosen: Mask) -> Array:
        """(rows, columns, 3) intensities from 0 to 1 of the chosen rays, 0 elsewhere."""
        rows, columns = chosen.shape
        lens = build_pinhole(columns, rows, camera.fovy_deg)
        lens = lens._replace(inside=freeze(chosen.astype(np.uint8)))
        desk: Desk = make_desk(lens, self._scene, eyes=1, full_grid=True)
        self._see(lens, desk, data, camera)
        brightness = desk.light[PLAIN_LIGHT, chosen] * desk.light[PATTERN_TONE, chosen]
        picture = np.zeros((rows, columns, 3))
        colors = self._rgb[desk.surface[chosen]]
        picture[chosen] = np.clip(colors * brightness[:, None], 0.0, 1.0)
        return picture

    def _see(self, lens: Lens, desk: Desk, data: mujoco.MjData, camera: SceneCamera) -> None:
        """Fill the desk's surface and light."""
        tables, shapes = (lens, self._scene, desk), (data.geom_xpos, data.geom_xmat)
        view = _look_at(camera), np.array([camera.position_m])
        if self._skin is None:
            render_pictures(*tables, *shapes, *view, True, True)
            return
        meshes, bodies = (self._skin.hull, self._room, self._skin.bodies), (data.xpos, data.xmat)
        render_with_meshes(*tables, *meshes, *shapes, *bodies, *view)


def _uneven(picture: Array) -> Mask:
    """(height, width) pixels that differ from a neighbour: more than one ray is worth its cost."""
    uneven = np.zeros(picture.shape[:2], dtype=np.bool_)
    across = np.abs(np.diff(picture, axis=1)).max(axis=2) > _EDGE_STEP
    down = np.abs(np.diff(picture, axis=0)).max(axis=2) > _EDGE_STEP
    uneven[:, 1:] |= across
    uneven[:, :-1] |= across
    uneven[1:] |= down
    uneven[:-1] |= down
    return uneven


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
