"""The last level: the posture, in what the levels above leave free."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from common.se3 import Array
from services.retarget.bounds import Box
from services.retarget.program import ProgramMaker, Shape
from services.retarget.rows import CAPACITY, Rows, restrict

REGULARISATION = 1e-3
"""rho: weight of a^T H a."""

_SLACK = 1e-7
_NOTHING = 1e-12


class Postured(NamedTuple):
    """Joint velocities (n,), share c of the posture task, number of failures."""

    a: Array
    c: float
    failures: int


class PostureLevel:
    """min 1/2 |W^(1/2) (a - x)|^2 + rho/2 a^T H a over a = a1 + Z z in the box and the rows.

    Without Z the optimum of each joint stands alone, y = W x / (W + rho H). With one spare joint z
    is a number and the answer is the unconstrained optimum, clipped to an interval. With more it is
    a quadratic program, and z = 0 its feasible fallback.

    Args:
        H: (n,) level-1 joint weights.
        W: (n,) posture weights.
        spare: k, the number of motions that the levels above leave free.
        make_program: What solves it.
    """

    def __init__(self, *, H: Array, W: Array, spare: int, make_program: ProgramMaker) -> None:
        self.weights: Array = W + REGULARISATION * H
        """(n,) diagonal of W + rho H."""
        self._pull = W / self.weights
        n = len(H)
        self._program = make_program(Shape(spare, n, narrow=True)) if spare > 1 else None
        self._with_rows = make_program(Shape(spare, n + CAPACITY, narrow=True)) if spare else None

    def optimum(self, x: Array) -> Array:
        """Optimum y (n,): where the posture velocities x (n,) would be best, alone."""
        return self._pull * x

    def solve(self, Z: Array, a1: Array, y: Array, box: Box, rows: Rows | None) -> Postured:
        """Move a solution of the levels above within their null space.

        Args:
            Z: (n, k) motions that the levels above do not notice.
            a1: (n,) their solution, in the box and the rows.
            y: (n,) optimum of the posture alone.
            box: Bounds.
            rows: Cartesian rows, or None.
        """
        spare = Z.shape[1]
        if spare == 0:
            return Postured(a1, 1.0, 0)
        if spare == 1 and rows is None:
            return self._solve_line(Z[:, 0], a1, y, box)
        WZ = self.weights[:, np.newaxis] * Z
        P = Z.T @ WZ
        rhs = (y - a1) @ WZ
        z_free = np.linalg.solve(P, rhs)
        a = a1 + Z @ z_free
        if box.contains(a) and (rows is None or rows.allow(a)):
            return Postured(a, 1.0, 0)
        z = self._solve_program(P, rhs, Z, a1, box, rows)
        if z is None:
            return Postured(a1, 0.0, 1)
        return Postured(a1 + Z @ z, share(float(z @ rhs), float(z_free @ rhs)), 0)

    def measure(self, a: Array, a_free: Array, a1: Array) -> float:
        """Share c that velocities a achieve of the way from a1 to the unbounded optimum a_free."""
        way = self.weights * (a_free - a1)
        return share(float((a - a1) @ way), float((a_free - a1) @ way))

    def _solve_line(self, Z: Array, a1: Array, y: Array, box: Box) -> Postured:
        Wz = self.weights * Z
        z_free = float((y - a1) @ Wz) / float(Z @ Wz)
        # In a corner of the box the line can miss it by rounding.
        first, last = box.cut_line(a1, Z) or (0.0, 0.0)
        z = min(max(z_free, first), last)
        return Postured(a1 + z * Z, share(z, z_free), 0)

    def _solve_program(
        self, P: Array, rhs: Array, Z: Array, a1: Array, box: Box, rows: Rows | None
    ) -> Array | None:
        G, lower, upper = restrict(Z, a1, box, rows)
        program = self._program if rows is None else self._with_rows
        if program is None:
            return None
        return program.solve(P, -rhs, G=G, h_l=lower - _SLACK, h_u=upper + _SLACK)


def share(achieved: float, wanted: float) -> float:
    """Ratio of what was achieved to what was wanted, in [0, 1]; 1 when nothing was wanted."""
    return 1.0 if abs(wanted) < _NOTHING else min(max(achieved / wanted, 0.0), 1.0)
