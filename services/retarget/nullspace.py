"""Weighted singular value decomposition of the hand Jacobian: pseudo-inverse and null space."""

from __future__ import annotations

import numpy as np

from common.se3 import Array
from services.retarget.lapack import decompose, is_positive

DAMPED_BELOW = 0.05
"""e = b: singular values below it are damped [m]. With 0.02 a stretched elbow can stay stuck at its
limit for seconds; working postures have 0.1 and more."""

_LEAST_SQUARES: Array = DAMPED_BELOW**2 * np.eye(6)


def is_regular(TJ: Array, H_root: Array) -> bool:
    """Whether no singular value of A = T J1 H^-1/2 needs damping, at a tenth of the SVD's cost.

    All of them are above e where A A^T - e^2 I has a Cholesky factor.

    Args:
        TJ: (6, n) T J1, the Jacobian with rotations scaled to metres.
        H_root: (n,) roots of the level-1 weights.
    """
    A = TJ / H_root
    return is_positive(A.dot(A.T) - _LEAST_SQUARES)


class WeightedJacobian:
    """What moves the hand and what does not.

    SVD: T J1 H^-1/2 = U S V^T. Null space Z = H^-1/2 V[:, 6:], so that J1 Z = 0 to rounding.
    Pseudo-inverse P+ y = H^-1/2 V1 f(S) U^T T y with f(s) = 1/s, but for s < e damped:
    f(s) = s / (s^2 + b^2 (1 - (s/e)^2)) = s / e^2.

    Args:
        TJ: (6, n) T J1, the Jacobian with rotations scaled to metres.
        H_root: (n,) roots of the level-1 weights.
    """

    def __init__(self, TJ: Array, H_root: Array) -> None:
        self.TJ = TJ
        self._H_root = H_root
        self._U, self._S, self._Vt = decompose(TJ / H_root)
        self.damping = max(0.0, DAMPED_BELOW**2 - float(self._S[-1]) ** 2)
        """The largest damping term b^2 (1 - (s/e)^2); zero away from singularities."""
        self.Z: Array = (self._Vt[6:] / H_root).T
        """(n, n - 6) basis of the motions that leave the hand at rest."""

    def pseudo_inverse(self, Ty: Array) -> Array:
        """Joint velocities P+ y (n,) for a hand twist T y (6,) with rotations scaled."""
        S = self._S
        y = self._U.T @ Ty
        y = y / S if self.damping == 0.0 else y * S / np.maximum(S, DAMPED_BELOW) ** 2
        return (y @ self._Vt[:6]) / self._H_root
