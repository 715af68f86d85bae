"""First hits of single rays, with distance and normal: for tests and measurements."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
import numpy.typing as npt

from common.se3 import Array
from services.sim.camera.compiled import digest_sources, entry
from services.sim.camera.rays import (
    DISTANCE,
    SHAPE_MET,
    X,
    Y,
    Z,
    make_marks,
    make_rays,
    trace,
)
from services.sim.camera.shading import LENGTH_M, world_normal
from services.sim.camera.shapes import Integers, Table, collect_shapes, place
from services.sim.camera.views import EYE, SIGHT, VIEWS, look_from


@dataclass(frozen=True)
class Hits:
    """What n rays met first.

    Args:
        geom: (n,) geom id, -1 where nothing was met.
        distance: (n,) in lengths of the ray's direction vector, -1 where nothing was met.
        normal: (n, 3) outward unit normal in the world; zero where nothing was met.
    """

    geom: npt.NDArray[np.int32]
    distance: Array
    normal: Array


class Tracer:
    """Traces rays through the drawable geoms of one model, as they are when it is made.

    Raises:
        UnsupportedGeom: A visible geom is of a kind without a formula.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self._shapes = collect_shapes(model)
        self._views = np.zeros((VIEWS, len(self._shapes)), dtype=SIGHT)

    def trace(self, data: mujoco.MjData, origin: Array, directions: Array) -> Hits:
        """Trace rays from one point against every drawable geom.

        Args:
            data: Kinematics are up to date.
            origin: (3,) in the world [m].
            directions: (n, 3) in the world, any length but zero.
        """
        count = len(directions)
        length = np.sqrt((directions * directions).sum(axis=1))
        rays, marks, normal = make_rays(count), make_marks(count), np.zeros((count, 3))
        rays[EYE, [X, Y, Z]] = (directions / length[:, None]).T
        rays[EYE, DISTANCE] = LENGTH_M
        candidates = np.zeros((1, 1 + len(self._shapes)), dtype=np.int64)
        trace_rays(
            self._shapes,
            self._views,
            data.geom_xpos,
            data.geom_xmat,
            np.array(origin, dtype=np.float64),
            rays,
            marks,
            candidates,
            normal,
        )
        met = marks[EYE, SHAPE_MET]
        geom = np.where(met >= 0, np.append(self._shapes["geom"], -1)[met], -1).astype(np.int32)
        distance = np.where(met >= 0, rays[EYE, DISTANCE] / length, -1.0)
        return Hits(geom, distance, normal)


def _build(
    version: int,
) -> Callable[[Table, Table, Array, Array, Array, Array, Integers, Integers, Array], int]:
    @entry
    def trace_rays(
        shapes: Table,
        views: Table,
        geom_xpos: Array,
        geom_xmat: Array,
        origin: Array,
        rays: Array,
        marks: Integers,
        candidates: Integers,
        normal: Array,
    ) -> int:
        """Trace all rays of the eye's bundle from `origin` (3,) and fill their normals (n, 3)."""
        count = len(normal)
        place(shapes, geom_xpos, geom_xmat)
        look_from(origin[0], origin[1], origin[2], shapes, views, EYE)
        candidates[0, 0] = len(shapes)
        for shape in range(len(shapes)):
            candidates[0, 1 + shape] = views[EYE, shape].order
        trace(rays, marks, EYE, count, shapes, views, candidates, 0)
        for k in range(count):
            met = marks[EYE, SHAPE_MET, k]
            if met >= 0:
                x, y, z = rays[EYE, X, k], rays[EYE, Y, k], rays[EYE, Z, k]
                t = rays[EYE, DISTANCE, k]
                normal[k, 0], normal[k, 1], normal[k, 2] = world_normal(
                    x, y, z, shapes[met], views[EYE, met], t
                )
        return version

    return trace_rays


trace_rays = _build(digest_sources())
