"""Level 2: the posture, in the null space of the hand."""

from __future__ import annotations

import numpy as np

from common.se3 import Array
from services.retarget.bounds import Box
from services.retarget.program import ConvexProgram

REGULARISATION = 1e-3
"""rho: weight of a^T H a in level 2."""

_SLACK = 1e-8
_NOTHING = 1e-12


class PostureLevel:
    """min 1/2 |W^(1/2) (a1 + Z z - x2)|^2 + rho/2 a^T H a over z, with l <= a1 + Z z <= u.

    With one spare joint z is a number and the answer is the unconstrained optimum, clipped to an
    interval. With more it is a quadratic program, and z = 0 its feasible fallback.

    Args:
        H: (n,) level-1 joint weights.
        W: (n,) level-2 joint weights.
    """

    def __init__(self, *, H: Array, W: Array) -> None:
        self._rho_H = REGULARISATION * H
        self._W = W
        self._weights = W + self._rho_H
        self._program = ConvexProgram(narrow=True)

    def solve(self, Z: Array, a1: Array, x2: Array, box: Box) -> tuple[Array, float, int] | None:
        """Move a solution of level 1 within the null space towards the posture.

        Whether there is an answer never depends on x2, so that the posture cannot change how
        level 1 is solved.

        Args:
            Z: (n, n - 6) null space of the hand.
            a1: (n,) solution of level 1; with one spare joint it may be outside the box.
            x2: (n,) wanted posture velocity.
            box: Bounds of the tick.

        Returns:
            Joint velocities (n,), share c2 of the posture task, number of failures; or None when
            a1 is outside (one spare joint: when no a1 + Z z is inside).
        """
        spare = Z.shape[1]
        if spare == 1:
            return self._solve_line(Z[:, 0], a1, x2, box)
        if not box.contains(a1):
            return None
        if spare == 0:
            return a1, 1.0, 0
        return self._solve_program(Z, a1, x2, box)

    def _solve_line(
        self, Z: Array, a1: Array, x2: Array, box: Box
    ) -> tuple[Array, float, int] | None:
        interval = box.cut_line(a1, Z)
        if interval is None:
            return None
        z_free = float(Z @ self._gradient(a1, x2)) / float(Z @ (self._weights * Z))
        z = min(max(z_free, interval[0]), interval[1])
        return a1 + z * Z, share(z, z_free), 0

    def _solve_program(self, Z: Array, a1: Array, x2: Array, box: Box) -> tuple[Array, float, int]:
        rhs = Z.T @ self._gradient(a1, x2)
        P = Z.T @ (self._weights[:, np.newaxis] * Z)
        z_free = np.linalg.solve(P, rhs)
        a = a1 + Z @ z_free
        if box.contains(a):
            return a, 1.0, 0
        h_l, h_u = np.array(box.lower) - a1 - _SLACK, np.array(box.upper) - a1 + _SLACK
        z = self._program.solve(P, -rhs, G=Z, h_l=h_l, h_u=h_u)
        if z is None:
            return a1, 0.0, 1
        return a1 + Z @ z, share(float(z @ rhs), float(z_free @ rhs)), 0

    def _gradient(self, a1: Array, x2: Array) -> Array:
        """Descent direction (n,) of the objective at z = 0."""
        return self._W * (x2 - a1) - self._rho_H * a1


def share(achieved: float, wanted: float) -> float:
    """Ratio of what was achieved to what was wanted, in [0, 1]; 1 when nothing was wanted."""
    return 1.0 if abs(wanted) < _NOTHING else min(max(achieved / wanted, 0.0), 1.0)
