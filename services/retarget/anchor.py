"""Level 0: the gentlest stop that keeps, or least violates, the Cartesian rows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from common.se3 import Array
from services.retarget.bounds import Box
from services.retarget.program import ProgramMaker, Shape
from services.retarget.rows import CAPACITY, Rows

STOP_WEIGHT = 1e-6
"""Weight of the distance to the full stop."""

_ROOM = 1e-7


class Anchor(NamedTuple):
    """A feasible point of the tick, and the rows that it keeps.

    Args:
        a: (n,) joint velocities.
        rows: Rows with the least slack they need, or None when there are none.
        failures: 1 when the solver gave up and the full stop was taken with all the slack it needs.
    """

    a: Array
    rows: Rows | None
    failures: int


class AnchorLevel:
    """min 1/2 |s|^2 + 1/2 1e-6 |a - a_s|^2 such that l <= a <= u, C a - s <= U, s >= 0.

    a_s = clip(0, l, u) is the nearest to a full stop. Where it keeps the rows, it is the answer.
    Otherwise the rows get the slack U + s + 1e-7. After that no level below can be infeasible.

    Args:
        n: Number of joints.
        make_program: What solves it.
    """

    def __init__(self, *, n: int, make_program: ProgramMaker) -> None:
        # Where bounds and rows leave no room, the duality gap cannot close to the last digits.
        size = n + CAPACITY
        self._programs = tuple(
            make_program(Shape(size, CAPACITY, bounds=True, narrow=narrow))
            for narrow in (False, True)
        )
        self._h_l = np.full(CAPACITY, -np.inf)
        self._n = n
        self._rest = np.zeros(n)
        self._P = np.diag([STOP_WEIGHT] * n + [1.0] * CAPACITY)
        self._x_l = np.zeros(size)
        self._x_u = np.full(size, np.inf)
        self._G = np.zeros((CAPACITY, size))
        self._G[:, n:] = -np.eye(CAPACITY)

    def stop(self, box: Box) -> Array:
        """a_s (n,): the velocities of the box nearest to rest."""
        return box.clip(self._rest)

    def solve(self, box: Box, rows: Rows | None) -> Anchor:
        """The anchor of one tick."""
        a_stop = self.stop(box)
        if rows is None or rows.allow(a_stop):
            return Anchor(a_stop, rows, 0)
        n = self._n
        self._x_l[:n], self._x_u[:n] = box.lower, box.upper
        self._G[:, :n] = rows.C
        c = np.zeros(n + CAPACITY)
        c[:n] = -STOP_WEIGHT * a_stop
        x = None
        for program in self._programs:
            x = program.solve(
                self._P, c, x_l=self._x_l, x_u=self._x_u, G=self._G, h_l=self._h_l, h_u=rows.U
            )
            if x is not None:
                break
        a = a_stop if x is None else box.clip(x[:n])
        needed = np.maximum(rows.C @ a - rows.U, 0.0)
        return Anchor(a, rows.slackened(np.where(needed > 0.0, needed + _ROOM, 0.0)), x is None)
