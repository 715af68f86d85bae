"""First hits of rays with the geoms of a MuJoCo model, by `mujoco.mj_multiRay`.

Geoms of groups 4 and 5 and geoms with alpha 0 do not exist for rays. No OpenGL takes part, and each
ray's result depends on that ray alone.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass

import mujoco
import numpy as np
import numpy.typing as npt

from common.se3 import Array
from services.sim.camera.bundles import Indices
from services.sim.camera.culling import Mask, drawable_geoms

_NO_CUTOFF_M = 1e10
_SEEN, _UNSEEN = 0, 1
_GROUPS = np.array([1, 0, 0, 0, 0, 0], dtype=np.uint8)


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
    """Traces rays through one model.

    It works on a private copy of the model, in which the geom groups say what the current bundle
    may meet. Positions are read from `MjData`; changes of sizes and colours made to the original
    model later are not seen.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = copy.copy(model)
        # Bundles know their geoms; MuJoCo's own bounding tests per body would only add to that.
        self._model.body_bvhadr[:] = -1
        self._drawable = drawable_geoms(model)

    def trace(self, data: mujoco.MjData, origin: Array, directions: Array) -> Hits:
        """Trace rays from one point against every drawable geom.

        Args:
            data: Kinematics are up to date.
            origin: (3,) in the world [m].
            directions: (n, 3) in the world, any length but zero.
        """
        return self.trace_bundles(
            data,
            origins=np.reshape(origin, (1, 3)),
            directions=directions,
            starts=np.array([0, len(directions)]),
            candidates=self._drawable[None, :],
        )

    def trace_bundles(
        self,
        data: mujoco.MjData,
        *,
        origins: Array,
        directions: Array,
        starts: Indices,
        candidates: Mask,
    ) -> Hits:
        """Trace bundles of rays, each against its own candidates.

        Args:
            data: Kinematics are up to date.
            origins: (bundles, 3) in the world [m].
            directions: (n, 3) in the world, bundle after bundle.
            starts: (bundles + 1,) where each bundle starts, and n.
            candidates: (bundles, ngeom) what each bundle may meet.
        """
        n = len(directions)
        geom = np.full(n, -1, dtype=np.int32)
        distance, normal = np.full(n, -1.0), np.zeros(3 * n)
        vectors = np.ascontiguousarray(directions, dtype=np.float64).reshape(-1)
        groups = np.where(candidates, _SEEN, _UNSEEN).astype(np.int32)
        group_in_force, edges = self._model.geom_group, starts.tolist()
        for bundle in np.flatnonzero(candidates.any(axis=1) & (starts[1:] > starts[:-1])).tolist():
            a, b = edges[bundle], edges[bundle + 1]
            group_in_force[:] = groups[bundle]
            mujoco.mj_multiRay(
                self._model,
                data,
                origins[bundle],
                vectors[3 * a : 3 * b],
                _GROUPS,
                True,
                -1,
                geom[a:b],
                distance[a:b],
                normal[3 * a : 3 * b],
                b - a,
                _NO_CUTOFF_M,
            )
        return Hits(geom, distance, normal.reshape(-1, 3))
