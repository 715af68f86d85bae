"""One level as near as possible to what it wants: bounded least squares."""

from __future__ import annotations

import numpy as np

from common.se3 import Array
from services.retarget.bounds import Box
from services.retarget.level import Level, Mask
from services.retarget.program import ProgramMaker, Shape
from services.retarget.rows import CAPACITY, Rows, restrict

REGULARISATION = 1e-9
"""Weight of a^T H a. It decides between equal solutions and is too small to move the hand."""

_SLACK = 1e-7


class Projection:
    """a = argmin 1/2 |T (J a - x)|^2 + 1/2 (1e-9 + damping) a^T H a in the box.

    Only the joints that move the level are unknowns; the others keep what they have.

    Args:
        H: (n,) joint weights.
        moves: (n,) mask of the unknowns.
        make_program: What solves it.
    """

    def __init__(self, *, H: Array, moves: Mask, make_program: ProgramMaker) -> None:
        self._all = bool(moves.all())
        self._columns = moves.nonzero()[0]
        self._H = H[self._columns]
        self._program = make_program(Shape(len(self._columns), bounds=True))

    def solve(self, level: Level, base: Array, box: Box, *, damping: float = 0.0) -> Array | None:
        """Joint velocities (n,) in the box, or None when the solver gives up.

        Args:
            level: What is wanted.
            base: (n,) velocities that the other joints keep.
            box: Bounds.
            damping: Added weight of a^T H a, near singularities.
        """
        if self._all:
            return self._solve_own(level, box, damping)
        k, a = self._columns, base.copy()
        a[k] = 0.0
        own = Level(level.J[:, k], level.x - level.J @ a, level.T)
        found = self._solve_own(own, Box(box.lower[k], box.upper[k]), damping)
        if found is None:
            return None
        a[k] = found
        return a

    def _solve_own(self, level: Level, box: Box, damping: float) -> Array | None:
        TJ = level.T[:, np.newaxis] * level.J
        P = TJ.T @ TJ
        P.flat[:: len(P) + 1] += (REGULARISATION + damping) * self._H
        a = self._program.solve(P, -((level.T * level.x) @ TJ), x_l=box.lower, x_u=box.upper)
        return None if a is None else box.clip(a)


class RowProjection:
    """The same under Cartesian rows, for the first level, with all joints as unknowns.

    Args:
        H: (n,) joint weights.
        make_program: What solves it.
    """

    def __init__(self, *, H: Array, make_program: ProgramMaker) -> None:
        self._H = H
        self._program = make_program(Shape(len(H), CAPACITY, bounds=True))
        self._h_l = np.full(CAPACITY, -np.inf)

    def solve(self, level: Level, box: Box, rows: Rows, *, damping: float) -> Array | None:
        """Joint velocities (n,) in the box and the rows, or None when the solver gives up."""
        TJ = level.T[:, np.newaxis] * level.J
        P = TJ.T @ TJ
        P.flat[:: len(P) + 1] += (REGULARISATION + damping) * self._H
        c = -((level.T * level.x) @ TJ)
        a = self._program.solve(
            P, c, x_l=box.lower, x_u=box.upper, G=rows.C, h_l=self._h_l, h_u=rows.U
        )
        return None if a is None else box.clip(a)


class NullSpaceProjection:
    """The same for a further level: a = base + Z z, where Z leaves the levels above as they are.

    Args:
        H: (n,) joint weights.
        spare: k, the number of columns of Z.
        make_program: What solves it.
    """

    def __init__(self, *, H: Array, spare: int, make_program: ProgramMaker) -> None:
        self._H = H
        n = len(H)
        self._program = make_program(Shape(spare, n, narrow=True))
        self._with_rows = make_program(Shape(spare, n + CAPACITY, narrow=True))

    def solve(
        self, level: Level, base: Array, Z: Array, box: Box, rows: Rows | None
    ) -> Array | None:
        """Joint velocities base + Z z (n,), or None when the solver gives up.

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
        program = self._program if rows is None else self._with_rows
        z = program.solve(P, c, G=G, h_l=lower - _SLACK, h_u=upper + _SLACK)
        return None if z is None else base + Z @ z
