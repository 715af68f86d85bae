"""The kernel of all cameras: one pass over the tiles of a lens for each eye."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

from common.se3 import Array
from services.sim.camera.compiled import device, digest_sources, entry
from services.sim.camera.culling import find_candidates
from services.sim.camera.desk import Desk
from services.sim.camera.grid import (
    COARSE,
    EVERY,
    PASSES,
    UNEVEN,
    aim,
    fill_even,
    keep_places,
    list_places,
    show,
    take_waiting,
)
from services.sim.camera.lens import Lens
from services.sim.camera.pyramids import raise_pyramid, turn_axes
from services.sim.camera.shading import find_tones, sample
from services.sim.camera.shadows import open_shadows
from services.sim.camera.shapes import Integers, Table, place
from services.sim.camera.tables import TILE, Scene
from services.sim.camera.views import EYE, look_from

Kernel: TypeAlias = Callable[[Lens, Scene, Desk, Array, Array, Array, Array, bool, bool], int]


@device
def raise_pyramids(axes: Array, bounds: Array, R: Array, frames: Array, pyramids: Array) -> None:
    """Bound the rays of all tiles; R is R_world_camera, frames is room for a frame."""
    for tile in range(len(bounds)):
        turn_axes(R, axes, tile, frames)
        left, right = bounds[tile, 0], bounds[tile, 1]
        top, bottom = bounds[tile, 2], bounds[tile, 3]
        raise_pyramid(frames, TILE, left, right, top, bottom, pyramids, tile)


@device
def open_eye(
    p_world_eyes: Array, eye: int, shapes: Table, views: Table, pyramids: Array, found: Integers
) -> None:
    """Look from one eye: what may each tile meet?"""
    x, y, z = p_world_eyes[eye, 0], p_world_eyes[eye, 1], p_world_eyes[eye, 2]
    look_from(x, y, z, shapes, views, EYE)
    for tile in range(len(pyramids)):
        find_candidates(pyramids, tile, shapes, views, EYE, found, tile)


def _build(version: int) -> Kernel:
    @entry
    def render_pictures(
        lens: Lens,
        scene: Scene,
        desk: Desk,
        geom_xpos: Array,
        geom_xmat: Array,
        R_world_camera: Array,
        p_world_eyes: Array,
        full_grid: bool,
        has_shadows: bool,
    ) -> int:
        """Fill desk.pictures; with a full grid also desk.surface and desk.light, of the last eye.

        Args:
            lens: The lens of all eyes.
            scene: Tables of the model.
            desk: Room to work in, made for this kind of grid.
            geom_xpos: (ngeom, 3) as in `MjData`.
            geom_xmat: (ngeom, 9) as in `MjData`.
            R_world_camera: (3, 3).
            p_world_eyes: (eyes, 3) [m].
            full_grid: Trace every pixel.
            has_shadows: Whether things cast shadows.

        Returns:
            The version of the sources that this kernel was compiled from.
        """
        R, rays, marks = R_world_camera, scene.rays, scene.marks
        place(scene.shapes, geom_xpos, geom_xmat)
        open_shadows(scene.shapes, scene.views, scene.light_cells)
        raise_pyramids(lens.axes, lens.bounds, R, scene.frames, desk.pyramids)
        for turn in range(len(p_world_eyes) * PASSES):
            eye, part = turn // PASSES, turn % PASSES
            if (part == EVERY) != full_grid:
                continue
            if part != UNEVEN:
                open_eye(
                    p_world_eyes, eye, scene.shapes, scene.views, desk.pyramids, desk.candidates
                )
            for tile in range(len(lens.tiles)):
                step, waiting = 1 + (part == COARSE), 0
                if part == UNEVEN:
                    count, waiting = fill_even(
                        lens.inside,
                        lens.tiles,
                        tile,
                        desk.surface,
                        desk.light,
                        scene.surfaces,
                        rays,
                        marks,
                        desk.pictures,
                        eye,
                        desk.bytes_of,
                    )
                elif part == COARSE:
                    count = list_places(lens.coarse, lens.tiles, tile, step, marks)
                else:
                    count = list_places(lens.inside, lens.tiles, tile, step, marks)
                if count > 0:
                    aim(rays, marks, count, lens.rays, R)
                    sample(scene, count, desk.candidates, tile, lens.ray_angle_rad, has_shadows)
                if part != UNEVEN:
                    keep_places(rays, marks, count, step, desk.surface, desk.light)
                if part != COARSE:
                    show(rays, marks, count, desk.pictures, eye, desk.bytes_of)
                if waiting > 0:
                    take_waiting(rays, marks, waiting)
                    aim(rays, marks, waiting, lens.rays, R)
                    find_tones(
                        rays,
                        marks,
                        waiting,
                        scene.shapes,
                        scene.surfaces,
                        scene.views,
                        lens.ray_angle_rad,
                    )
                    show(rays, marks, waiting, desk.pictures, eye, desk.bytes_of)
        return version

    return render_pictures


render_pictures = _build(digest_sources())
