"""Rotation vectors and matrices in torch, batched, with finite gradients everywhere they are used.

exp(w) = (1 - b t^2) I + a [w] + b w w',  t = |w|,
         a = sin t / t,  b = (1 - cos t) / t^2 = 2 (sin(t/2) / t)^2
log(R) = (t / sin t) vee(R - R') / 2,  t = atan2(sin t, (tr R - 1) / 2)

Below an angle of 1e-4 (its square: 1e-8) the quotients are series in t^2. The dead branch of a
`where` still gets a gradient, so the argument is made safe first and divided afterwards.

Products are sums of elementwise products, not matrix products: those would be rounded to bfloat16
under autocast and to TF32 on a GPU.
"""

from __future__ import annotations

import torch
from torch import Tensor

_SERIES_BELOW = 1e-8
"""Square of the angle."""


def exp3(rotation_vectors: Tensor) -> Tensor:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3) [rad]."""
    square = (rotation_vectors * rotation_vectors).sum(dim=-1)
    small = square < _SERIES_BELOW
    safe = torch.where(small, 1.0, square)
    angle = safe.sqrt()
    a = torch.where(small, 1.0 - square / 6.0, angle.sin() / angle)
    b = torch.where(small, 0.5 - square / 24.0, 2.0 * ((0.5 * angle).sin() / angle) ** 2)
    x, y, z = rotation_vectors.unbind(dim=-1)
    bx, by, bz = b * x, b * y, b * z
    ax, ay, az = a * x, a * y, a * z
    cosine = 1.0 - b * square
    entries = [
        *(cosine + bx * x, bx * y - az, bx * z + ay),
        *(bx * y + az, cosine + by * y, by * z - ax),
        *(bx * z - ay, by * z + ax, cosine + bz * z),
    ]
    return torch.stack(entries, dim=-1).unflatten(-1, (3, 3))


def log3(R: Tensor) -> Tensor:
    """Rotation vectors (..., 3) [rad] of matrices (..., 3, 3).

    For angles up to about pi - 0.05, beyond which the axis is lost in R - R'; a step of a gripper
    at 10 Hz turns by less than 0.3.
    """
    half = 0.5 * torch.stack(
        [
            R[..., 2, 1] - R[..., 1, 2],
            R[..., 0, 2] - R[..., 2, 0],
            R[..., 1, 0] - R[..., 0, 1],
        ],
        dim=-1,
    )
    cosine = 0.5 * (R[..., 0, 0] + R[..., 1, 1] + R[..., 2, 2] - 1.0)
    square = (half * half).sum(dim=-1)
    small = square < _SERIES_BELOW
    sine = torch.where(small, 1.0, square).sqrt()
    quotient = torch.where(small, 1.0 + square / 6.0, torch.atan2(sine, cosine) / sine)
    return quotient[..., None] * half


def compose(A: Tensor, B: Tensor) -> Tensor:
    """Product A B of matrices (..., 3, 3)."""
    return (A[..., :, :, None] * B[..., None, :, :]).sum(dim=-2)


def rotate(A: Tensor, v: Tensor) -> Tensor:
    """A v of matrices (..., 3, 3) and vectors (..., 3)."""
    return (A * v[..., None, :]).sum(dim=-1)
