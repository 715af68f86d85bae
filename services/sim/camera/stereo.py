"""The gripper's stereo camera: two grayscale pictures by ray tracing."""

from __future__ import annotations

from typing import TypeAlias

import mujoco
import numpy as np
import numpy.typing as npt

from common.calibration import R_TOOL_CAMERA, StereoCalibration
from common.errors import UnknownName
from services.sim.camera.bundles import Indices
from services.sim.camera.lighting import sky, to_display
from services.sim.camera.look import Look, Optics, Samples, Selection
from services.sim.camera.pixel_grid import PixelGrid
from services.sim.camera.surface import Integers

Picture: TypeAlias = npt.NDArray[np.float32]

REFINE_STEP = 0.04
"""A cell whose corners differ by more than this in intensity is traced pixel by pixel."""


_HALF = np.float32(0.5)


class StereoCamera:
    """Renders what the two eyes see.

    By default every second pixel is traced; the pixels between are interpolated where the four
    traced neighbours meet the same geom with nearly the same intensity, and traced elsewhere.
    With `full_grid` every pixel is traced. Pixels outside the image circle are 0.

    Args:
        model: The model that is looked at; its sizes and colours are read now.
        calibration: Lens and places of the eyes.
        tool_site: Site at the tool frame.
        full_grid: Trace every pixel.
        shadows: Whether things cast shadows.

    Raises:
        UnknownName: The model has no such site.
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
        self._grid = PixelGrid(calibration)
        self._optics = Optics(
            model,
            directions=self._grid.directions,
            tile=self._grid.tile,
            ray_angle_rad=self._grid.center_angle_rad,
            shadows=shadows,
        )
        first = self._grid.pixel_rays if full_grid else self._grid.coarse_rays
        self._first = self._for_both(first)

    def render(self, data: mujoco.MjData) -> tuple[bytes, bytes]:
        """Render left and right picture.

        Args:
            data: State of the model; site and geom poses must be up to date (`mj_kinematics`).

        Returns:
            Left and right: height x width bytes, row by row from the top, upright, not mirrored.
        """
        look = self._look(data)
        intensity = self._trace_all(look) if self._full_grid else self._trace_adaptively(look)
        pictures = to_display(intensity)
        pictures[:, self._grid.outside_at] = 0
        return pictures[0].tobytes(), pictures[1].tobytes()

    def _look(self, data: mujoco.MjData) -> Look:
        R_world_tool = data.site_xmat[self._site].reshape(3, 3)
        offsets = (R_world_tool[None] * self._p_tool_eyes[:, None, :]).sum(axis=2)
        return Look(
            self._optics,
            data,
            R_world_camera=R_world_tool @ R_TOOL_CAMERA,
            p_world_eyes=data.site_xpos[self._site] + offsets,
        )

    def _for_both(self, ray: Indices) -> Selection:
        eye = np.repeat(np.arange(2), len(ray))
        return self._optics.select(eye, np.concatenate([ray, ray]), eyes=2)

    def _plain(self, samples: Samples) -> Picture:
        """Intensity without patterns."""
        surface = samples.lit.surface
        lit = self._optics.surfaces.gray.take(surface, mode="wrap") * samples.lit.factor
        return np.where(surface < 0, sky(samples.ray_z), lit).astype(np.float32)

    def _trace_all(self, look: Look) -> Picture:
        samples = look.sample(self._first)
        pictures = np.zeros((2, self._grid.size), dtype=np.float32)
        intensity = self._plain(samples) * samples.lit.tone
        pictures[:, self._grid.pixel_at] = intensity.reshape(2, -1)
        return pictures

    def _trace_adaptively(self, look: Look) -> Picture:
        grid = self._grid
        samples = look.sample(self._first)
        plain = grid.on_coarse(self._plain(samples))
        surface = grid.on_coarse(samples.lit.surface)
        uneven = _uneven(surface, plain)
        fine = _interpolate(plain, grid.on_coarse(samples.lit.tone.astype(np.float32)))
        pictures = np.ascontiguousarray(fine[:, : grid.shape[0], : grid.shape[1]]).ravel()

        # Patterns where the surface is known: no ray is needed.
        patterned = self._optics.surfaces.is_checkered(surface[:, None, :-1, :-1]) & ~uneven
        eye, chosen = grid.gaps_where(patterned)
        corner = grid.between_corner.take(chosen) + eye * plain[0].size
        pictures[grid.between_at.take(chosen) + eye * grid.size] *= look.tone_at_height(
            self._optics.select(eye, grid.between_rays.take(chosen), eyes=2),
            surface=surface.take(corner),
            z_m=grid.on_coarse(samples.lit.z_m).take(corner),
        )

        eye, chosen = grid.gaps_where(uneven)
        samples = look.sample(self._optics.select(eye, grid.between_rays.take(chosen), eyes=2))
        intensity = self._plain(samples) * samples.lit.tone
        pictures[grid.between_at.take(chosen) + eye * grid.size] = intensity
        return pictures.reshape(2, -1)


def _uneven(surface: Integers, plain: Picture) -> npt.NDArray[np.bool_]:
    """Which gaps of the coarse grid may hide an edge, by what lies around them.

    Args:
        surface: (eyes, r, c) on the coarse grid.
        plain: (eyes, r, c) intensity on the coarse grid, without patterns.

    Returns:
        (eyes, 3, r - 1, c - 1): to the right of a coarse place, below it, and between it and its
        three neighbours right and below.
    """
    low_x, high_x = (f(plain[..., :-1], plain[..., 1:]) for f in (np.minimum, np.maximum))
    low, high = np.minimum(low_x[:, :-1], low_x[:, 1:]), np.maximum(high_x[:, :-1], high_x[:, 1:])
    across = surface[..., 1:] != surface[..., :-1]
    down = (surface[:, 1:] != surface[:, :-1])[..., :-1]
    right = across | (high_x - low_x > REFINE_STEP)
    below = down | (np.abs(plain[:, 1:, :-1] - plain[:, :-1, :-1]) > REFINE_STEP)
    cell = across[:, :-1] | across[:, 1:] | down | (high - low > REFINE_STEP)
    return np.stack([right[:, :-1], below, cell], axis=1)


def _interpolate(coarse: Picture, tone: Picture) -> Picture:
    """Twice as fine: (eyes, r, c) to (eyes, 2 r - 2, 2 c - 2).

    Even places are coarse x tone; the places between are means of their neighbours, without tone.
    """
    eyes, rows, columns = coarse.shape
    fine = np.empty((eyes, 2 * rows - 2, 2 * columns - 2), dtype=np.float32)
    halfway_down = _HALF * (coarse[:, :-1] + coarse[:, 1:])
    fine[:, ::2, ::2] = (coarse * tone)[:, :-1, :-1]
    fine[:, ::2, 1::2] = _HALF * (coarse[:, :-1, :-1] + coarse[:, :-1, 1:])
    fine[:, 1::2, ::2] = halfway_down[..., :-1]
    fine[:, 1::2, 1::2] = _HALF * (halfway_down[..., :-1] + halfway_down[..., 1:])
    return fine
