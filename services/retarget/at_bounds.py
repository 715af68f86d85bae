"""Levels at their bounds: the solution when what moves a level has no choice left."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from common.se3 import Array
from services.retarget.bounds import Box
from services.retarget.exact import ExactSolver
from services.retarget.lapack import smallest_pivot
from services.retarget.level import Level, LevelShape, Mask
from services.retarget.posture import PostureLevel
from services.retarget.program import ProgramMaker
from services.retarget.projection import Projection
from services.retarget.rows import Rows
from services.retarget.solution import Solution, measure_level, stack_levels

_MULTIPLIER = 1e-6
"""A joint whose multiplier is larger holds the level back: moving it would change the level."""
_MET = 1e-7
"""Residual below which a level counts as met."""
_PIVOT = 1e-5


class Attempt(NamedTuple):
    """What was found.

    Args:
        solution: Of all levels, or None.
        a1: (n,) solution of the first level alone, or None.
        met: Whether the first level turned out to be possible after all.
    """

    solution: Solution | None
    a1: Array | None
    met: bool = False


class AtBounds:
    """Each level as near as the box allows, as long as that leaves none of its joints any choice.

    At the optimum of a level a joint with a multiplier stays at its bound. The others span what the
    level could still do; when their columns are independent, none of them can move either. Joints
    that never move the level are free for those below, where the same is tried: all of them met
    exactly, or the next one at its bounds.

    Args:
        H: (n,) level-1 joint weights.
        shapes: Of all levels but the posture.
        posture: The last level.
        make_program: What solves programs.
    """

    def __init__(
        self,
        *,
        H: Array,
        shapes: Sequence[LevelShape],
        posture: PostureLevel,
        make_program: ProgramMaker,
    ) -> None:
        self._moves = [shape.moves for shape in shapes]
        self._own = _list_own_joints(self._moves)
        self._projections = [
            Projection(H=H, moves=own, make_program=make_program) for own in self._own
        ]
        self._posture = posture
        rows = [shape.rows for shape in shapes]
        # One for each number of levels that are left, the last for one.
        self._exact = [
            ExactSolver(D=1.0 / posture.weights, rows=sum(rows[i:])) for i in range(1, len(rows))
        ]

    def project_first(
        self, level: Level, base: Array, box: Box, *, damping: float = 0.0
    ) -> Array | None:
        """The first level alone (n,), or None when the solver gives up."""
        return self._projections[0].solve(level, base, box, damping=damping)

    def solve(self, levels: Sequence[Level], y: Array, box: Box, rows: Rows | None) -> Attempt:
        """Try it.

        Args:
            levels: All but the posture.
            y: (n,) optimum of the posture alone.
            box: Bounds.
            rows: Cartesian rows that the solution has to keep, or None.
        """
        a1 = self.project_first(levels[0], box.clip(0.0 * y), box)
        if a1 is None or not (rows is None or rows.allow(a1)):
            return Attempt(None, None)
        a, rest, shares = a1, box, []
        for i, level in enumerate(levels):
            if not _is_fixed(level, self._own[i], a):
                return Attempt(None, a1, met=i == 0)
            shares.append(measure_level(level, a))
            moves = self._moves[i]
            rest = Box(np.where(moves, a, rest.lower), np.where(moves, a, rest.upper))
            below = self._solve_below(i + 1, levels, y, rest)
            if below is not None:
                a = below
                shares += [1.0] * (len(levels) - len(shares))
                break
            projected = self._projections[i + 1].solve(levels[i + 1], a, rest)
            if projected is None:
                return Attempt(None, a1)
            a = projected
        if not (rows is None or rows.allow(a)):
            return Attempt(None, a1)
        a_free = np.where(rest.lower == rest.upper, a, y)
        return Attempt(Solution(a, [*shares, self._posture.measure(a, a_free, a1)], 0), a1)

    def _solve_below(
        self, first: int, levels: Sequence[Level], y: Array, rest: Box
    ) -> Array | None:
        """Velocities (n,) that meet all levels from `first` on, with the joints above at rest."""
        if first == len(levels):
            return rest.clip(y)
        stack, exact = stack_levels(levels[first:]), self._exact[first - 1]
        start = exact.solve_unbounded(stack.J, stack.x, stack.T, y)
        a = exact.solve(stack.J, stack.x, y, start, rest, search=True)
        if a is not None:
            exact.remember(a, rest)
        return a


def _list_own_joints(moves: Sequence[Mask]) -> list[Mask]:
    """Of every level the joints that move it and no level above it."""
    own: list[Mask] = []
    taken = np.zeros_like(moves[0])
    for mask in moves:
        own.append(mask & ~taken)
        taken = taken | mask
    return own


def _is_fixed(level: Level, own: Mask, a: Array) -> bool:
    """Whether at the optimum a (n,) of a level none of its own joints has a choice."""
    residual = level.T * (level.J @ a - level.x)
    if np.abs(residual).max() < _MET:
        return False
    multipliers = (level.T * residual) @ level.J
    return _are_independent(level.J[:, (np.abs(multipliers) <= _MULTIPLIER) & own])


def _are_independent(columns: Array) -> bool:
    """Whether columns (m, k) span k dimensions, k < m."""
    if columns.shape[1] == 0:
        return True
    if columns.shape[1] >= len(columns):
        return False
    return smallest_pivot(columns.T @ columns) > _PIVOT
