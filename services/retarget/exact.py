"""All tasks met exactly, with the best posture: the solution when nothing is in the way."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from common.se3 import Array
from services.retarget.bounds import Box
from services.retarget.lapack import solve_positive

ATTAINED = 1e-10
"""Largest |J a - x| that counts as met [m/s, rad/s]."""

_STEPS = 6
_AT_BOUND = 1e-7
_OVERSHOOT = 0.5


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


class _Point(NamedTuple):
    """What multipliers lambda (m,) lead to: velocities in the box, what the task still lacks."""

    multipliers: Array
    a: Array
    inside: Array
    residual: Array


class ExactSolver:
    """min 1/2 (a - y)' D^-1 (a - y)  such that  J a = x and l <= a <= u.

    y is the posture's own optimum and D^-1 its diagonal weight. For multipliers lambda of J a = x
    the minimiser is known, a(lambda) = clip(y + D J' lambda, l, u), and what is left is the
    piecewise linear equation J a(lambda) = x. Newton's step on it solves one system of the size of
    the task, with the Jacobian of the joints that are not clipped; its length is cut where the
    residual turns around. Without a clipped joint the first step is the answer, and no quadratic
    program is needed. With clipped ones it starts from those of the last tick.

    Args:
        D: (n,) inverse posture weights.
        rows: m, the number of task rows.
    """

    def __init__(self, *, D: Array, rows: int) -> None:
        self._D = D
        self._rhs = np.asfortranarray(np.eye(rows, rows + 1, 1))
        self._last: tuple[Array, Box] | None = None

    def remember(self, a: Array, box: Box) -> None:
        """Note the solution (n,) of a tick: the next one begins where it stood at its bounds."""
        self._last = a, box

    def solve_unbounded(self, J: Array, x: Array, T: Array, y: Array) -> Unbounded:
        """The first step, from lambda = 0, as if there were no bounds.

        Args:
            J: (m, n).
            x: (m,) task velocity.
            T: (m,) row weights, only for the trace.
            y: (n,) best posture velocity.
        """
        JD = J * self._D
        self._rhs[:, 0] = x - J.dot(y)
        solved = solve_positive(JD.dot(J.T), self._rhs)
        if solved is None:
            return Unbounded(y, np.zeros(len(x)), np.inf)
        multipliers: Array = solved[:, 0]
        trace = float(solved.diagonal(1).dot(1.0 / (T * T)))
        return Unbounded(y + multipliers.dot(JD), multipliers, trace)

    def solve(
        self, J: Array, x: Array, y: Array, start: Unbounded, box: Box, *, search: bool
    ) -> Array | None:
        """Joint velocities (n,) in the box with J a = x; None when they are not found.

        Args:
            J: (m, n).
            x: (m,) task velocity.
            y: (n,) best posture velocity.
            start: The solution without bounds.
            box: Bounds.
            search: Whether to look further when that one is not in the box.
        """
        if start.inverse_trace == np.inf:
            return None
        if box.contains(start.a):
            return start.a
        if not search:
            return None
        JD = J * self._D
        point = self._start_from_last(J, JD, x, y, box)
        if point is None:
            inside = box.clip(start.a)
            point = _Point(start.multipliers, start.a, inside, x - J @ inside)
        for _ in range(_STEPS):
            if np.abs(point.residual).max() <= ATTAINED:
                return point.inside
            step = solve_positive((JD * (point.inside == point.a)) @ J.T, point.residual)
            if step is None:
                return None
            point = _advance(point, step, J, JD, x, y, box)
        return None

    def _start_from_last(self, J: Array, JD: Array, x: Array, y: Array, box: Box) -> _Point | None:
        """The solution if the same joints are clipped as in the last tick."""
        if self._last is None:
            return None
        a, last = self._last
        at_lower, at_upper = a <= last.lower + _AT_BOUND, a >= last.upper - _AT_BOUND
        # A joint without any room stands at both.
        free = at_lower == at_upper
        if free.all():
            return None
        held = np.where(free, y, np.where(at_upper, box.upper, box.lower))
        multipliers = solve_positive((JD * free) @ J.T, x - J @ held)
        return None if multipliers is None else _evaluate(multipliers, J, JD, x, y, box)


def _evaluate(multipliers: Array, J: Array, JD: Array, x: Array, y: Array, box: Box) -> _Point:
    a = y + multipliers @ JD
    inside = box.clip(a)
    return _Point(multipliers, a, inside, x - J @ inside)


def _advance(
    point: _Point, step: Array, J: Array, JD: Array, x: Array, y: Array, box: Box
) -> _Point:
    """A Newton step, shortened by the secant rule when it goes far too far."""
    slope, length = float(point.residual @ step), 1.0
    following = _evaluate(point.multipliers + step, J, JD, x, y, box)
    beyond = float(following.residual @ step)
    if beyond < -_OVERSHOOT * slope:
        length = slope / (slope - beyond)
        following = _evaluate(point.multipliers + length * step, J, JD, x, y, box)
    return following
