"""The rigid-motion functions everyone uses.

Poses are homogeneous matrices `T_a_b` (4, 4): the pose of frame b in frame a, so that
`T_a_c = T_a_b @ T_b_c`. On the wire a pose is seven numbers `[x, y, z, qw, qx, qy, qz]`, metres and
a unit quaternion (`wxyz`). Rotation vectors are in radians.

Small matrices are handled with plain floats: at this size that is several times faster than
array code, and the result does not depend on how memory is aligned, so traces stay bit-identical.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

Array: TypeAlias = npt.NDArray[np.float64]
Quaternion: TypeAlias = tuple[float, float, float, float]
"""wxyz."""

_SMALL_ANGLE_RAD = 1e-8

_IDENTITY: Array = np.eye(4)
_IDENTITY.flags.writeable = False


def exp3(rotation_vector: Sequence[float] | Array) -> Array:
    """Rotation matrix R = exp([w]x), by Rodrigues' formula.

    Args:
        rotation_vector: (3,) axis times angle w [rad].

    Returns:
        (3, 3) rotation matrix.
    """
    x, y, z = float(rotation_vector[0]), float(rotation_vector[1]), float(rotation_vector[2])
    angle = math.sqrt(x * x + y * y + z * z)
    if angle < _SMALL_ANGLE_RAD:
        a, b = 1.0, 0.5
    else:
        a = math.sin(angle) / angle
        half = math.sin(0.5 * angle) / angle
        b = 2.0 * half * half
    c = math.cos(angle)
    return np.array(
        [
            [c + b * x * x, b * x * y - a * z, b * x * z + a * y],
            [b * x * y + a * z, c + b * y * y, b * y * z - a * x],
            [b * x * z - a * y, b * y * z + a * x, c + b * z * z],
        ]
    )


def log3(R: Array) -> Array:
    """Rotation vector w with exp([w]x) = R and |w| <= pi, through the quaternion.

    Args:
        R: (3, 3) rotation matrix.

    Returns:
        (3,) rotation vector [rad].
    """
    return np.array(log_quat(quat_from_matrix(R)))


def log_quat(quat_wxyz: Quaternion) -> tuple[float, float, float]:
    """Rotation vector [rad] of a unit quaternion with w >= 0, no longer than pi."""
    w, x, y, z = quat_wxyz
    norm = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 / w if norm < _SMALL_ANGLE_RAD else 2.0 * math.atan2(norm, w) / norm
    return scale * x, scale * y, scale * z


def exp_quat(rotation_vector: Sequence[float]) -> Quaternion:
    """Unit quaternion (cos(|r| / 2), sin(|r| / 2) r / |r|) of a rotation vector r [rad]."""
    x, y, z = rotation_vector
    angle = math.sqrt(x * x + y * y + z * z)
    s = 0.5 if angle < _SMALL_ANGLE_RAD else math.sin(0.5 * angle) / angle
    return math.cos(0.5 * angle), s * x, s * y, s * z


def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """Product a b: the rotation b followed by a."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def relative_rotation(a: Quaternion, b: Quaternion) -> tuple[float, float, float]:
    """Rotation vector from a to b in frame a: log(a^-1 b), no longer than pi [rad].

    Args:
        a: Unit quaternion.
        b: Unit quaternion.
    """
    w, x, y, z = multiply((a[0], -a[1], -a[2], -a[3]), b)
    return log_quat((w, x, y, z) if w >= 0.0 else (-w, -x, -y, -z))


def quat_from_matrix(R: Array) -> Quaternion:
    """Unit quaternion wxyz of a rotation matrix, with w >= 0 (Shepperd's method)."""
    (r00, r01, r02), (r10, r11, r12), (r20, r21, r22) = R.tolist()
    trace = r00 + r11 + r22
    if trace > 0.0:
        s = 2.0 * math.sqrt(1.0 + trace)
        q = (0.25 * s, (r21 - r12) / s, (r02 - r20) / s, (r10 - r01) / s)
    elif r00 >= r11 and r00 >= r22:
        s = 2.0 * math.sqrt(1.0 + r00 - r11 - r22)
        q = ((r21 - r12) / s, 0.25 * s, (r01 + r10) / s, (r02 + r20) / s)
    elif r11 >= r22:
        s = 2.0 * math.sqrt(1.0 + r11 - r00 - r22)
        q = ((r02 - r20) / s, (r01 + r10) / s, 0.25 * s, (r12 + r21) / s)
    else:
        s = 2.0 * math.sqrt(1.0 + r22 - r00 - r11)
        q = ((r10 - r01) / s, (r02 + r20) / s, (r12 + r21) / s, 0.25 * s)
    w, x, y, z = q
    norm = math.copysign(math.sqrt(w * w + x * x + y * y + z * z), w)
    return w / norm, x / norm, y / norm, z / norm


def matrix_from_quat(quat_wxyz: Sequence[float] | Array) -> Array:
    """Rotation matrix (3, 3) of a quaternion wxyz, which need not be normalised."""
    w, x, y, z = (float(c) for c in quat_wxyz)
    s = 2.0 / (w * w + x * x + y * y + z * z)
    return np.array(
        [
            [1.0 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
            [s * (x * y + w * z), 1.0 - s * (x * x + z * z), s * (y * z - w * x)],
            [s * (x * z - w * y), s * (y * z + w * x), 1.0 - s * (x * x + y * y)],
        ]
    )


def make_pose(R: Array, p: Sequence[float] | Array) -> Array:
    """Homogeneous matrix (4, 4) of a rotation (3, 3) and a translation (3,) [m]."""
    T = _IDENTITY.copy()
    T[:3, :3] = R
    T[:3, 3] = p
    return T


def pose_from_wire(wire: Sequence[float]) -> Array:
    """Homogeneous matrix (4, 4) of `[x, y, z, qw, qx, qy, qz]` [m, -]."""
    return make_pose(matrix_from_quat(wire[3:7]), wire[:3])


def pose_to_wire(T: Array) -> list[float]:
    """`[x, y, z, qw, qx, qy, qz]` of a homogeneous matrix (4, 4)."""
    return [*T[:3, 3].tolist(), *quat_from_matrix(T[:3, :3])]


def invert(T: Array) -> Array:
    """Inverse of a rigid motion: T_b_a = T_a_b^-1, (4, 4)."""
    R_transposed = T[:3, :3].T
    return make_pose(R_transposed, -R_transposed @ T[:3, 3])


def differential(T_a_b: Array, T_a_c: Array) -> tuple[Array, Array]:
    """Motion from b to c expressed in b: T_b_c = T_a_b^-1 T_a_c.

    Returns:
        Translation (3,) [m] and rotation vector (3,) [rad], both in frame b.
    """
    T_b_c = invert(T_a_b) @ T_a_c
    return T_b_c[:3, 3].copy(), log3(T_b_c[:3, :3])


def apply_differential(
    T_a_b: Array, translation: Sequence[float] | Array, rotation_vector: Sequence[float] | Array
) -> Array:
    """T_a_c = T_a_b [exp(w), d; 0, 1], with d [m] and w [rad] expressed in b.

    The rotation is re-normalised, so that thousands of compositions stay a rigid motion.
    """
    T = T_a_b @ make_pose(exp3(rotation_vector), translation)
    T[:3, :3] = matrix_from_quat(quat_from_matrix(T[:3, :3]))
    return T


def distance(T_a_b: Array, T_a_c: Array) -> tuple[float, float]:
    """Distance [m] and angle [rad] between two poses given in one frame."""
    d = (T_a_b[:3, 3] - T_a_c[:3, 3]).tolist()
    w = log_quat(quat_from_matrix(T_a_b[:3, :3].T @ T_a_c[:3, :3]))
    return math.hypot(*d), math.hypot(*w)
