"""One level as near as possible to what it wants: bounded least squares."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from common.se3 import Array
from services.retarget.bounds import Box
from services.retarget.level import Level
from services.retarget.program import Program
from services.retarget.rows import Rows, restrict

REGULARISATION = 1e-9
"""Weight of a^T H a. It decides between equal solutions and is too small to move the hand."""

_SLACK = 1e-7


class Projection:
    """a = argmin 1/2 |T (J a - x)|^2 + 1/2 (1e-9 + damping) a^T H a in the box and the rows.

    Below the first level a = base + Z z, where Z leaves the levels above as they are.

    Args:
        H: (n,) joint weights.
        make_program: What solves it.
    """

    def __init__(self, *, H: Array, make_program: Callable[[bool], Program]) -> None:
        self._H = H
        # One workspace per shape.
        self._plain = make_program(False)
        self._with_rows = make_program(False)
        self._below = make_program(True)
        self._below_with_rows = make_program(True)

    def solve(
        self, level: Level, box: Box, rows: Rows | None = None, *, damping: float = 0.0
    ) -> Array | None:
        """The first level: joint velocities (n,) in the box, or None when the solver gives up."""
        TJ = level.T[:, np.newaxis] * level.J
        P = TJ.T @ TJ
        P.flat[:: len(P) + 1] += (REGULARISATION + damping) * self._H
        c = -((level.T * level.x) @ TJ)
        if rows is None:
            a = self._plain.solve(P, c, x_l=box.lower, x_u=box.upper)
        else:
            a = self._with_rows.solve(P, c, x_l=box.lower, x_u=box.upper, G=rows.C, h_u=rows.U)
        return None if a is None else box.clip(a)

    def solve_below(
        self, level: Level, base: Array, Z: Array, box: Box, rows: Rows | None
    ) -> Array | None:
        """A further level: joint velocities base + Z z (n,), or None when the solver gives up.

        Args:
            level: What is wanted.
            base: (n,) solution of the levels above, in the box and the rows.
            Z: (n, k) motions that the levels above do not notice.
            box: Bounds.
            rows: Cartesian rows, or None.
        """
        TJZ = level.T[:, np.newaxis] * (level.J @ Z)
        P = TJZ.T @ TJZ + REGULARISATION * (Z.T @ (self._H[:, np.newaxis] * Z))
        c = -((level.T * (level.x - level.J @ base)) @ TJZ)
        G, lower, upper = restrict(Z, base, box, rows)
        program = self._below if rows is None else self._below_with_rows
        z = program.solve(P, c, G=G, h_l=lower - _SLACK, h_u=upper + _SLACK)
        return None if z is None else base + Z @ z
