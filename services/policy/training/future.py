"""Where the hand will be, seen from where it is: labels that every demonstration has."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from common.se3 import Array, log3, matrix_from_quat

Floats = npt.NDArray[np.float32]

_LARGEST = 4.0
"""In units of the spread: nothing rarer is to rule the gradient."""


def look_ahead(poses: Floats, spans: npt.NDArray[np.int64], horizons: Sequence[int]) -> Floats:
    """d_h = T_t^-1 T_{min(t+h, end)} as translation and rotation vector, each over its RMS.

    Args:
        poses: (rows, 7) measured T_world_tool of all episodes [m, quaternion wxyz].
        spans: (episodes, 2) first row and length of each.
        horizons: h, in steps.

    Returns:
        (rows, len(horizons), 6), within 4 of zero.
    """
    ahead = np.zeros((len(poses), len(horizons), 6))
    rotations = np.array([matrix_from_quat(quaternion) for quaternion in poses[:, 3:].tolist()])
    for start, length in spans.tolist():
        rows = np.arange(start, start + length)
        for number, horizon in enumerate(horizons):
            later = np.minimum(rows + horizon, start + length - 1)
            ahead[rows, number] = _differences(poses, rotations, rows, later)
    spread = np.sqrt(np.mean(ahead**2, axis=0)) if len(ahead) else np.ones(ahead.shape[1:])
    scaled = np.clip(ahead / np.maximum(spread, 1e-6), -_LARGEST, _LARGEST)
    return scaled.astype(np.float32)


def _differences(
    poses: Floats,
    rotations: Array,
    rows: npt.NDArray[np.int64],
    later: npt.NDArray[np.int64],
) -> Array:
    """(n, 6) of T_row^-1 T_later."""
    way = poses[later, :3].astype(np.float64) - poses[rows, :3]
    translation = np.einsum("nji,nj->ni", rotations[rows], way)
    turn = np.einsum("nji,njk->nik", rotations[rows], rotations[later])
    return np.concatenate([translation, np.array([log3(R) for R in turn])], axis=1)
