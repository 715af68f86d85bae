"""The kernel of colour pictures with meshes; only they compile it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

from common.se3 import Array
from services.sim.camera.compiled import digest_sources, entry
from services.sim.camera.desk import Desk
from services.sim.camera.grid import aim, keep_places, list_places
from services.sim.camera.kernel import open_eye, raise_pyramids
from services.sim.camera.lens import Lens
from services.sim.camera.meshes.hull import Hull
from services.sim.camera.meshes.room import Room, place_shells
from services.sim.camera.meshes.shading import sample_with_meshes
from services.sim.camera.shadows import open_shadows
from services.sim.camera.shapes import Integers, place
from services.sim.camera.tables import Scene

Kernel: TypeAlias = Callable[
    [Lens, Scene, Desk, Hull, Room, Integers, Array, Array, Array, Array, Array, Array], int
]


def _build(version: int) -> Kernel:
    @entry
    def render_with_meshes(
        lens: Lens,
        scene: Scene,
        desk: Desk,
        hull: Hull,
        room: Room,
        bodies: Integers,
        geom_xpos: Array,
        geom_xmat: Array,
        body_xpos: Array,
        body_xmat: Array,
        R_world_camera: Array,
        p_world_eyes: Array,
    ) -> int:
        """Fill desk.surface and desk.light: what every pixel sees, from one eye, with shadows.

        Args:
            lens: Its lens.
            scene: Tables of the model without the geoms that meshes stand for.
            desk: Room to work in, made for a full grid.
            hull: Triangles of s shells.
            room: Room to work in.
            bodies: (s,) body that carries each shell.
            geom_xpos: (ngeom, 3) as in `MjData`.
            geom_xmat: (ngeom, 9) as in `MjData`.
            body_xpos: (nbody, 3) as in `MjData`.
            body_xmat: (nbody, 9) as in `MjData`.
            R_world_camera: (3, 3).
            p_world_eyes: (1, 3) [m].

        Returns:
            The version of the sources that this kernel was compiled from.
        """
        R, rays, marks = R_world_camera, scene.rays, scene.marks
        eye = p_world_eyes[0, 0], p_world_eyes[0, 1], p_world_eyes[0, 2]
        place(scene.shapes, geom_xpos, geom_xmat)
        place_shells(room.places, hull.spheres, bodies, body_xpos, body_xmat)
        open_shadows(scene.shapes, scene.views, scene.light_cells)
        raise_pyramids(lens.axes, lens.bounds, R, scene.frames, desk.pyramids)
        open_eye(p_world_eyes, 0, scene.shapes, scene.views, desk.pyramids, desk.candidates)
        for tile in range(len(lens.tiles)):
            count = list_places(lens.inside, lens.tiles, tile, 1, marks)
            if count > 0:
                aim(rays, marks, count, lens.rays, R)
                angle = lens.ray_angle_rad
                sample_with_meshes(scene, hull, room, eye, count, desk.candidates, tile, angle)
                keep_places(rays, marks, count, 1, desk.surface, desk.light)
        return version

    return render_with_meshes


render_with_meshes = _build(digest_sources(Path(__file__).parent))
