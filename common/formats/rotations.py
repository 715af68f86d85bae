"""Other ways to write rotations, for many rows at once; LEGATO itself keeps rotation vectors.

Roll-pitch-yaw (x, y, z) is about the fixed axes x, then y, then z: R = Rz(z) Ry(y) Rx(x).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

_SMALL_RAD = 1e-9


def quaternions_from_vectors(vectors: Floats) -> Floats:
    """(n, 4) unit quaternions wxyz of (n, 3) rotation vectors [rad]."""
    angle = np.linalg.norm(vectors, axis=1, keepdims=True)
    safe = np.where(angle < _SMALL_RAD, 1.0, angle)
    factor = np.where(angle < _SMALL_RAD, 0.5, np.sin(0.5 * angle) / safe)
    return np.concatenate([np.cos(0.5 * angle), factor * vectors], axis=1)


def vectors_from_quaternions(quaternions: Floats) -> Floats:
    """(n, 3) rotation vectors, no longer than pi [rad], of (n, 4) unit quaternions wxyz."""
    shorter = np.where(quaternions[:, :1] < 0.0, -quaternions, quaternions)
    w, xyz = shorter[:, :1], shorter[:, 1:]
    norm = np.linalg.norm(xyz, axis=1, keepdims=True)
    safe = np.where(norm < _SMALL_RAD, 1.0, norm)
    return np.where(norm < _SMALL_RAD, 2.0, 2.0 * np.arctan2(norm, w) / safe) * xyz


def rpy_from_vectors(vectors: Floats) -> Floats:
    """(n, 3) roll, pitch, yaw [rad] of (n, 3) rotation vectors [rad]."""
    w, x, y, z = quaternions_from_vectors(vectors).T
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return np.stack([roll, pitch, yaw], axis=1)


def vectors_from_rpy(rpy: Floats) -> Floats:
    """(n, 3) rotation vectors, no longer than pi [rad], of (n, 3) roll, pitch, yaw [rad]."""
    cr, cp, cy = np.cos(0.5 * rpy).T
    sr, sp, sy = np.sin(0.5 * rpy).T
    quaternions = np.stack(
        [
            cy * cp * cr + sy * sp * sr,
            cy * cp * sr - sy * sp * cr,
            cy * sp * cr + sy * cp * sr,
            sy * cp * cr - cy * sp * sr,
        ],
        axis=1,
    )
    return vectors_from_quaternions(quaternions)
