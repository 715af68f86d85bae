"""One level as the largest share of what it wants: the paper's scaling factor."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from common.se3 import Array
from services.retarget.bounds import Box
from services.retarget.program import ProgramMaker, Shape
from services.retarget.rows import CAPACITY, Rows, restrict

_FLATTEN = 1e-8
_ROOMS = (0.0, 1e-8, 1e-7)


class Scaled(NamedTuple):
    """Joint velocities (n,) and the share c in [0, 1] of the task that they achieve."""

    a: Array
    c: float


class Scaling:
    """max c over (c, z): a = base + c a_p + Z z in the box and the rows, 0 <= c <= 1.

    a_p is the motion that would meet the task, J a_p = x - J base, and J Z = 0, so that
    J a = J base + c (x - J base). From rest (base = 0) it is the paper's J a = c x. Feasible with
    c = 0, z = 0. A weight of 1e-8 on z keeps the program's solution unique.

    Args:
        n: Number of joints.
        spare: k, the number of motions that the task does not notice.
        make_program: What solves it.
    """

    def __init__(self, *, n: int, spare: int, make_program: ProgramMaker) -> None:
        self._program = make_program(Shape(1 + spare, n, bounds=True))
        self._with_rows = make_program(Shape(1 + spare, n + CAPACITY, bounds=True))

    def solve(
        self, base: Array, a_p: Array, Z: Array, box: Box, rows: Rows | None
    ) -> Scaled | None:
        """The largest share, or None when the solver gives up.

        Args:
            base: (n,) in the box and the rows.
            a_p: (n,) motion that would meet the task.
            Z: (n, k) motions that it does not notice.
            box: Bounds.
            rows: Cartesian rows, or None.
        """
        G, lower, upper = restrict(np.column_stack([a_p, Z]), base, box, rows)
        program = self._program if rows is None else self._with_rows
        size = G.shape[1]
        P = _FLATTEN * np.eye(size)
        P[0, 0] = 0.0
        x_l, x_u = np.full(size, -np.inf), np.full(size, np.inf)
        x_l[0], x_u[0] = 0.0, 1.0
        # A set without any room is only solved when it is given some.
        for room in _ROOMS:
            h_l, h_u = lower - room, upper + room
            x = program.solve(P, -np.eye(size)[0], x_l=x_l, x_u=x_u, G=G, h_l=h_l, h_u=h_u)
            if x is not None:
                a = box.clip(base + G[: len(base)] @ x)
                return Scaled(a, min(max(float(x[0]), 0.0), 1.0))
        return None
