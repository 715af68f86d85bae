"""All tasks met exactly, with the best posture: the solution when nothing is in the way."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from common.se3 import Array
from services.retarget.bounds import Box
from services.retarget.lapack import solve_positive

ATTAINED = 1e-10
"""Largest |J a - x| that counts as met [m/s, rad/s]."""


class Unbounded(NamedTuple):
    """The solution without bounds.

    Args:
        a: (n,) joint velocities.
        multipliers: (m,) lambda.
        inverse_trace: trace((T J D J' T)^-1), or infinity when J has no full rank.
    """

    a: Array
    multipliers: Array
    inverse_trace: float


class ExactSolver:
    """min 1/2 (a - y)' D^-1 (a - y)  such that  J a = x and l <= a <= u.

    y is the posture's own optimum and D^-1 its diagonal weight. For multipliers lambda of J a = x
    the minimiser is known, a(lambda) = clip(y + D J' lambda, l, u), and what is left is the
    piecewise linear equation J a(lambda) = x. Newton's step on it solves one system of the size of
    the task, with the Jacobian of the joints that are not clipped. Without a clipped joint the
    first step is the answer, and no quadratic program is needed.

    Args:
        D: (n,) inverse posture weights.
        rows: m, the number of task rows.
    """

    def __init__(self, *, D: Array, rows: int) -> None:
        self._D = D
        self._rhs = np.asfortranarray(np.eye(rows, rows + 1, 1))

    def solve_unbounded(self, J: Array, x: Array, T: Array, y: Array) -> Unbounded:
        """The first step, from lambda = 0, as if there were no bounds.

        Args:
            J: (m, n).
            x: (m,) task velocity.
            T: (m,) row weights, only for the trace.
            y: (n,) best posture velocity.
        """
        JD = J * self._D
        self._rhs[:, 0] = x - J @ y
        solved = solve_positive(JD @ J.T, self._rhs)
        if solved is None:
            return Unbounded(y, np.zeros(len(x)), np.inf)
        multipliers: Array = solved[:, 0]
        trace = float(solved.diagonal(1) @ (1.0 / (T * T)))
        return Unbounded(y + multipliers @ JD, multipliers, trace)

    def solve(
        self, J: Array, x: Array, y: Array, start: Unbounded, box: Box, *, steps: int
    ) -> Array | None:
        """Joint velocities (n,) in the box with J a = x; None when not found in so many steps.

        Args:
            J: (m, n).
            x: (m,) task velocity.
            y: (n,) best posture velocity.
            start: The solution without bounds.
            box: Bounds.
            steps: Newton steps to try after the first.
        """
        if start.inverse_trace == np.inf:
            return None
        a, multipliers = start.a, start.multipliers
        lower, upper = box
        inside = np.minimum(np.maximum(a, lower), upper)
        free = inside == a
        if free.all():
            return a
        JD = J * self._D
        for _ in range(steps):
            step = solve_positive((JD * free) @ J.T, x - J @ inside)
            if step is None:
                return None
            multipliers = multipliers + step
            a = y + multipliers @ JD
            inside = np.minimum(np.maximum(a, lower), upper)
            if np.abs(J @ inside - x).max() <= ATTAINED:
                return inside
            free = inside == a
        return None
