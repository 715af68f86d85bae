"""Single rays through the triangles of a hull, for tests."""

from __future__ import annotations

import numpy as np
from numba import njit

from services.sim.camera.meshes import Hull
from services.sim.camera.meshes.walk import DEEPEST, walk


def trace_hull(
    hull: Hull, origins: np.ndarray, directions: np.ndarray, *, any_will_do: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Distance (n,), infinite where nothing is met, and triangle (n,) of the first shell."""
    return _trace(hull, origins, directions, any_will_do)


@njit(error_model="numpy")
def _trace(hull, origins, directions, any_will_do):
    distances, triangles = np.full(len(origins), np.inf), np.full(len(origins), -1)
    waiting, entries = np.zeros(DEEPEST, np.int64), np.zeros(DEEPEST)
    for k in range(len(origins)):
        o = origins[k, 0], origins[k, 1], origins[k, 2]
        d = directions[k, 0], directions[k, 1], directions[k, 2]
        met, t, _, _ = walk(
            hull.corners, hull.boxes, hull.parts, 0, o, d, 1e9, any_will_do, waiting, entries
        )
        if met >= 0:
            distances[k], triangles[k] = t, met
    return distances, triangles
