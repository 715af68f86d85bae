"""The gripper's stereo camera: two grayscale pictures by ray tracing."""

from __future__ import annotations

import mujoco
import numpy as np

from common.calibration import R_TOOL_CAMERA, StereoCalibration
from common.errors import UnknownName
from services.sim.camera.desk import make_desk
from services.sim.camera.kernel import render_pictures
from services.sim.camera.lens import MOST_RAYS, build_lens
from services.sim.camera.tables import make_scene


class StereoCamera:
    """Renders what the two eyes see.

    By default every second pixel is traced; the pixels between are interpolated where the traced
    neighbours meet the same surface with nearly the same intensity, and traced elsewhere. With
    `full_grid` every pixel is traced. Pixels outside the image circle are 0.

    Args:
        model: The model that is looked at; its sizes, colours and names are read now.
        calibration: Lens and places of the eyes.
        tool_site: Site at the tool frame.
        full_grid: Trace every pixel.
        shadows: Whether things cast shadows.

    Raises:
        UnknownName: The model has no such site.
        UnsupportedGeom: A visible geom is of a kind that cannot be drawn.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        calibration: StereoCalibration,
        *,
        tool_site: str,
        full_grid: bool = False,
        shadows: bool = True,
    ) -> None:
        self._site = int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, tool_site))
        if self._site < 0:
            sites = [str(model.site(site).name) for site in range(model.nsite)]
            raise UnknownName("site", tool_site, sites)
        self._p_tool_eyes = np.array([calibration.p_tool_left_m, calibration.p_tool_right_m])
        self._full_grid = full_grid
        self._shadows = shadows
        # A frozen pydantic model has a hash, which type checkers do not know.
        self._lens = build_lens(calibration)  # pyright: ignore[reportArgumentType]
        self._scene = make_scene(model, most=MOST_RAYS)
        self._desk = make_desk(self._lens, self._scene, eyes=2, full_grid=full_grid)

    def render(self, data: mujoco.MjData) -> tuple[bytes, bytes]:
        """Render left and right picture.

        Args:
            data: State of the model; site and geom poses must be up to date (`mj_kinematics`).

        Returns:
            Left and right: height x width bytes, row by row from the top, upright, not mirrored.
        """
        R_world_tool = data.site_xmat[self._site].reshape(3, 3)
        # Elementwise sums: no BLAS, same bits everywhere.
        offsets = (R_world_tool[None] * self._p_tool_eyes[:, None, :]).sum(axis=2)
        R_world_camera = (R_world_tool[:, :, None] * R_TOOL_CAMERA[None]).sum(axis=1)
        render_pictures(
            self._lens,
            self._scene,
            self._desk,
            data.geom_xpos,
            data.geom_xmat,
            R_world_camera,
            data.site_xpos[self._site] + offsets,
            self._full_grid,
            self._shadows,
        )
        left, right = self._desk.pictures
        return left.tobytes(), right.tobytes()
