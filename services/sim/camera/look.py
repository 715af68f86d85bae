"""One look at the world from one or more eyes: culled, traced and lit rays."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from common.se3 import Array
from services.sim.camera.bundles import Indices, bound_directions
from services.sim.camera.culling import Bounds
from services.sim.camera.lighting import LIGHT_M, Lighting, Lit
from services.sim.camera.surface import Integers, Surfaces
from services.sim.camera.tracer import Tracer


class Optics:
    """The fixed rays of a lens, in bundles, and what is needed to follow them through a model.

    Args:
        model: The model that is looked at.
        directions: (n, 3) unit vectors in the camera frame, tile after tile.
        tile: (n,) tile of each ray, from 0, not decreasing.
        ray_angle_rad: Angle between neighbouring rays near the axis.
        shadows: Whether things cast shadows.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        *,
        directions: Array,
        tile: Indices,
        ray_angle_rad: float,
        shadows: bool,
    ) -> None:
        self.count = len(directions)
        self.components = np.ascontiguousarray(directions.T)
        self.tile = tile
        starts = np.append(np.flatnonzero(np.diff(tile, prepend=-1)), self.count)
        tangents = bound_directions(directions, starts)
        self.tile_normals, self.tile_corners = tangents.normals(), tangents.corners()
        self.surfaces = Surfaces(model)
        self.bounds = Bounds(model)
        self.tracer = Tracer(model)
        self.lighting = Lighting(
            self.surfaces, self.tracer, ray_angle_rad=ray_angle_rad, shadows=shadows
        )

    def select(self, eye: Indices, ray: Indices, *, eyes: int) -> Selection:
        """Choose rays.

        Args:
            eye: (k,) eye of each ray, not decreasing.
            ray: (k,) number of each ray, increasing within an eye.
            eyes: Number of eyes.
        """
        tiles = len(self.tile_normals)
        bundle = self.tile.take(ray) + eye * tiles
        return Selection(
            eye=eye,
            components=np.stack([component.take(ray) for component in self.components]),
            starts=np.searchsorted(bundle, np.arange(eyes * tiles + 1)),
        )


@dataclass(frozen=True)
class Selection:
    """Some of the rays of all eyes, with what can be known about them in advance.

    Args:
        eye: (k,) eye of each ray.
        components: (3, k) unit vectors in the camera frame.
        starts: (eyes * tiles + 1,) where the rays of each bundle start, and k.
    """

    eye: Indices
    components: Array
    starts: Indices


@dataclass(frozen=True)
class Samples:
    """What some rays see: how their hits are lit, and the world z of the unit rays (k,)."""

    lit: Lit
    ray_z: Array


class Look:
    """The rays of one lens at one moment, from all eyes that share one orientation.

    Args:
        optics: The lens.
        data: State of the model; site and geom poses must be up to date.
        R_world_camera: (3, 3).
        p_world_eyes: (eyes, 3) [m].
    """

    def __init__(
        self, optics: Optics, data: mujoco.MjData, *, R_world_camera: Array, p_world_eyes: Array
    ) -> None:
        self._optics = optics
        self._data = data
        self._R: list[list[float]] = R_world_camera.tolist()
        self._eyes = np.ascontiguousarray(p_world_eyes.T)
        tiles = len(optics.tile_normals)
        self._origins = np.repeat(p_world_eyes, tiles, axis=0)
        placed = optics.bounds.place(data)
        self._candidates = placed.in_pyramids(
            optics.tile_normals @ R_world_camera.T,
            optics.tile_corners @ R_world_camera.T,
            apexes=p_world_eyes,
        )
        self._silhouettes = placed.seen_from_above(np.array(LIGHT_M))

    def sample(self, selection: Selection) -> Samples:
        """Trace and light the chosen rays."""
        rays = self._rays(selection)
        hits = self._optics.tracer.trace_bundles(
            self._data,
            origins=self._origins,
            directions=rays.T,
            starts=selection.starts,
            candidates=self._candidates,
        )
        lit = self._optics.lighting.light(
            self._data,
            self._silhouettes,
            hits=hits,
            origins=self._eyes.take(selection.eye, axis=1),
            rays=rays,
        )
        return Samples(lit, rays[2])

    def tone_at_height(self, selection: Selection, *, surface: Integers, z_m: Array) -> Array:
        """Pattern on horizontal faces that rays are known to meet: (k,) each, see `Lighting`."""
        return self._optics.lighting.tone_at_height(
            surface,
            origins=self._eyes.take(selection.eye, axis=1),
            rays=self._rays(selection),
            z_m=z_m,
        )

    def _rays(self, selection: Selection) -> Array:
        """(3, k) unit vectors in the world, by elementwise sums: no BLAS, same bits everywhere."""
        x, y, z = selection.components
        rays = np.empty(selection.components.shape)
        for axis, (r_x, r_y, r_z) in enumerate(self._R):
            rays[axis] = r_x * x + r_y * y + r_z * z
        return rays
