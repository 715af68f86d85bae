"""Cartesian rows: how fast points of the robot may approach walls and obstacles."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from common.se3 import Array
from services.retarget.bounds import Box

CAPACITY = 12
"""Most rows of one tick. Programs keep their shape; the nearest ones are taken."""

_ANYTHING_M_S = 1e3
_TIGHT_M_S = 1e-6


class Rows(NamedTuple):
    """C a <= U, padded with empty rows to `CAPACITY`.

    Args:
        C: (CAPACITY, n).
        U: (CAPACITY,) [m/s], without meaning in empty rows.
        names: What each row keeps apart.
    """

    C: Array
    U: Array
    names: list[str]

    def allow(self, a: Array) -> bool:
        """Whether joint velocities (n,) keep all rows."""
        return bool((self.C @ a <= self.U).all())

    def leave_room(self, a: Array) -> bool:
        """Whether joint velocities (n,) are away from all rows."""
        return bool((self.C @ a < self.U - _TIGHT_M_S).all())

    def slackened(self, slack: Array) -> Rows:
        """The same rows with more room [m/s]."""
        return self._replace(U=self.U + slack)


class Restriction(NamedTuple):
    """lower <= G z <= upper: what box and rows allow of a = base + M z."""

    G: Array
    lower: Array
    upper: Array


def restrict(M: Array, base: Array, box: Box, rows: Rows | None) -> Restriction:
    """Carry the bounds of a over to z.

    Args:
        M: (n, k) with a = base + M z.
        base: (n,) joint velocities.
        box: Bounds of a.
        rows: Cartesian rows, or None.
    """
    lower, upper = box.lower - base, box.upper - base
    if rows is None:
        return Restriction(M, lower, upper)
    nothing = np.full(len(rows.U), -np.inf)
    return Restriction(
        np.vstack([M, rows.C @ M]),
        np.concatenate([lower, nothing]),
        np.concatenate([upper, rows.U - rows.C @ base]),
    )


class Approach(NamedTuple):
    """One pair that is near: n' (J_p1 - J_p2) a <= speed.

    Args:
        row: (n,).
        distance_m: For choosing the nearest.
        speed_m_s: Largest speed of approach.
        name: What is kept apart.
    """

    row: Array
    distance_m: float
    speed_m_s: float
    name: str


def gather_rows(approaches: list[Approach], n: int) -> Rows | None:
    """Rows of the nearest approaches; None when nothing is near."""
    if not approaches:
        return None
    nearest = sorted(approaches, key=lambda approach: approach.distance_m)[:CAPACITY]
    C = np.zeros((CAPACITY, n))
    U = np.full(CAPACITY, _ANYTHING_M_S)
    for i, approach in enumerate(nearest):
        C[i] = approach.row
        U[i] = approach.speed_m_s
    return Rows(C, U, [approach.name for approach in nearest])
