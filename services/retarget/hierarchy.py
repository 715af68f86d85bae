"""Strict priorities: walls, then the hand, then what else is wanted, then the posture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from common.se3 import Array
from services.retarget.anchor import Anchor, AnchorLevel
from services.retarget.bounds import Box
from services.retarget.exact import ExactSolver, Unbounded
from services.retarget.lapack import decompose, smallest_pivot
from services.retarget.level import Level, LevelShape, Mask
from services.retarget.nullspace import DAMPED_BELOW, WeightedJacobian
from services.retarget.posture import PostureLevel, share
from services.retarget.program import PIQP, make_program
from services.retarget.projection import NullSpaceProjection, Projection, RowProjection
from services.retarget.rows import Rows
from services.retarget.scaling import Scaling

Mode = Literal["project", "scale"]

_MULTIPLIER = 1e-6
"""A joint whose multiplier is larger holds the hand back: moving it would change the hand."""
_MET = 1e-7
"""Residual below which level 1 counts as met."""
_PIVOT = 1e-5


class Solution(NamedTuple):
    """What the hierarchy decided for one tick.

    Args:
        a: (n,) joint velocities [rad/s, m/s].
        scaling: Share of every level that is achieved, the posture's last.
        failures: Levels that fell back to their feasible default.
    """

    a: Array
    scaling: list[float]
    failures: int


class _Partial(NamedTuple):
    """Solution (n,) of the levels so far, what they leave free (n, k), their shares, failures."""

    a: Array
    Z: Array
    shares: list[float]
    failures: int


class Hierarchy:
    """Solves all levels in a box that is never empty, whatever the levels want.

    Level 0 keeps the Cartesian rows, with the least slack. Level 1 moves the hand: `project` as
    near to the wanted twist as possible, `scale` along it as far as possible. Further levels and
    the posture move within what is left, J1 Z = 0, so the hand never notices them. Every fallback
    is feasible.

    Three ways lead to the solution, from cheap to general: all levels met exactly (`ExactSolver`,
    no program); the hand at its bounds, where nothing of what moves it is left free (one program);
    level by level (one program each). Which of them is taken never changes the hand.

    Args:
        H: (n,) level-1 joint weights.
        W: (n,) posture weights.
        shapes: Of all levels but the posture, the hand first.
        mode: How level 1 treats a twist that is not possible.
        solver: `piqp`, or another one by its name in qpsolvers.

    Raises:
        UnknownName: There is no such solver.
    """

    def __init__(
        self,
        *,
        H: Array,
        W: Array,
        shapes: Sequence[LevelShape],
        mode: Mode = "project",
        solver: str = PIQP,
    ) -> None:
        program = make_program(solver)
        n, rows = len(H), [shape.rows for shape in shapes]
        self._mode = mode
        self._H = H
        self._H_root = np.sqrt(H)
        self._moves = [shape.moves for shape in shapes]
        self._anchor = AnchorLevel(n=n, make_program=program)
        # Each level with the joints that no level above it uses.
        self._projections = [
            Projection(H=H, moves=moves, make_program=program)
            for moves in _list_own_joints(self._moves)
        ]
        self._row_projection = RowProjection(H=H, make_program=program)
        self._below = [
            NullSpaceProjection(H=H, spare=n - sum(rows[:i]), make_program=program)
            for i in range(1, len(rows))
        ]
        self._scaling = Scaling(n=n, spare=n - rows[0], make_program=program)
        self._posture = PostureLevel(H=H, W=W, spare=n - sum(rows), make_program=program)
        D = 1.0 / self._posture.weights
        # One for each number of levels that are left.
        self._exact = [ExactSolver(D=D, rows=sum(rows[i:])) for i in range(len(rows))]
        # s_min(T J1 H^-1/2)^2 >= kappa / trace((T J1 D J1' T)^-1): no need of its SVD below this.
        self._safe_trace = float((1.0 / (H * D)).min()) / DAMPED_BELOW**2
        self._was_met = True
        self._held_by_rows = False

    def solve(self, levels: Sequence[Level], x: Array, box: Box, rows: Rows | None) -> Solution:
        """Joint velocities for one tick.

        Args:
            levels: The hand (six rows), then others.
            x: (n,) wanted posture velocity.
            box: Bounds of the tick.
            rows: Cartesian rows, or None when nothing is near.
        """
        y = self._posture.optimum(x)
        stack = _stack(levels)
        start = self._exact[0].solve_unbounded(stack.J, stack.x, stack.T, y)
        hand = None
        if start.inverse_trace > self._safe_trace:
            hand = self._decompose(levels[0])
        if hand is None or hand.damping == 0.0:
            solution = self._solve_exactly(stack, y, start, box, rows, len(levels))
            self._was_met = solution is not None
            a1 = None
            if solution is None and self._mode == "project":
                solution, a1 = self._solve_at_bounds(levels, y, box, rows)
            if solution is None:
                solution = self._solve_by_levels(levels, y, box, rows, hand, a1)
        else:
            solution = self._solve_by_levels(levels, y, box, rows, hand, None)
        self._exact[0].remember(solution.a, box)
        return solution

    def _decompose(self, level: Level) -> WeightedJacobian:
        return WeightedJacobian(level.T[:, np.newaxis] * level.J, self._H_root)

    def _solve_exactly(
        self, stack: Level, y: Array, start: Unbounded, box: Box, rows: Rows | None, levels: int
    ) -> Solution | None:
        """All levels met."""
        # While the hand is held back by the bounds, searching costs more than it brings.
        exact = self._exact[0]
        a = exact.solve(stack.J, stack.x, y, start, box, search=self._was_met)
        if a is None or not (rows is None or rows.allow(a)):
            return None
        posture = 1.0
        if a is not start.a:
            least = exact.solve_unbounded(stack.J, stack.x, stack.T, 0.0 * y).a
            posture = self._posture.measure(a, start.a, least)
        return Solution(a, [1.0] * levels + [posture], 0)

    def _solve_at_bounds(
        self, levels: Sequence[Level], y: Array, box: Box, rows: Rows | None
    ) -> tuple[Solution | None, Array | None]:
        """The hand as near as the box allows, if that leaves none of its joints any choice.

        At the optimum a joint with a multiplier stays at its bound. The others span what the hand
        could still do; when their columns are independent, none of them can move either. Joints
        that never move the hand are free for the levels below, where the same is tried.

        Returns:
            The solution or None, and what level 1 alone gave, or None.
        """
        if self._held_by_rows:
            return None, None
        a1 = self._projections[0].solve(levels[0], self._anchor.stop(box), box)
        if a1 is None or not (rows is None or rows.allow(a1)):
            return None, None
        shares: list[float] = []
        a, rest, pending = a1, box, list(levels)
        while pending:
            level, moves = pending.pop(0), self._moves[len(shares)]
            if not _is_fixed(level, moves, a):
                self._was_met = self._was_met or not shares
                return None, a1
            shares.append(_measure(level, a))
            if moves.all():
                return Solution(a, [*shares, *(_measure(one, a) for one in pending), 0.0], 0), a1
            rest = Box(np.where(moves, a, rest.lower), np.where(moves, a, rest.upper))
            found = self._solve_below_fixed(pending, y, rest)
            if found is not None:
                a, pending = found, []
                shares += [1.0] * (len(levels) - len(shares))
            else:
                below = self._projections[len(shares)].solve(pending[0], a, rest)
                if below is None:
                    return None, a1
                a = below
        if not (rows is None or rows.allow(a)):
            return None, a1
        a_free = np.where(rest.lower == rest.upper, a, y)
        return Solution(a, [*shares, self._posture.measure(a, a_free, a1)], 0), a1

    def _solve_below_fixed(self, levels: Sequence[Level], y: Array, rest: Box) -> Array | None:
        """What is left when the joints of the levels above stand still, if it can all be met."""
        if not levels:
            return rest.clip(y)
        stack, exact = _stack(levels), self._exact[-len(levels)]
        start = exact.solve_unbounded(stack.J, stack.x, stack.T, y)
        a = exact.solve(stack.J, stack.x, y, start, rest, search=True)
        if a is not None:
            exact.remember(a, rest)
        return a

    def _solve_by_levels(
        self,
        levels: Sequence[Level],
        y: Array,
        box: Box,
        rows: Rows | None,
        hand: WeightedJacobian | None,
        a1: Array | None,
    ) -> Solution:
        """One level after the other, each in what those above leave free."""
        hand = hand or self._decompose(levels[0])
        anchor = self._anchor.solve(box, rows)
        if a1 is not None:
            found = _Partial(a1, hand.Z, [_measure(levels[0], a1)], 0)
        elif self._mode == "scale":
            found = self._scale_hand(levels[0], hand, anchor, box)
        else:
            found = self._project_hand(levels[0], hand, anchor, box)
        for level, below in zip(levels[1:], self._below, strict=True):
            found = _project_below(level, below, found, box, anchor.rows)
        posture = self._posture.solve(found.Z, found.a, y, box, anchor.rows)
        a = box.clip(posture.a)
        self._held_by_rows = anchor.rows is not None and not anchor.rows.leave_room(a)
        failures = anchor.failures + found.failures + posture.failures
        return Solution(a, [*found.shares, posture.c], failures)

    def _project_hand(
        self, level: Level, hand: WeightedJacobian, anchor: Anchor, box: Box
    ) -> _Partial:
        if hand.damping > 0.0:
            # The damped motion is the answer wherever it is possible, not only the projection's.
            a = hand.pseudo_inverse(level.T * level.x)
            if box.contains(a) and (anchor.rows is None or anchor.rows.allow(a)):
                return _Partial(a, hand.Z, [_measure(level, a)], 0)
        if anchor.rows is None:
            a = self._projections[0].solve(level, anchor.a, box, damping=hand.damping)
        else:
            a = self._row_projection.solve(level, box, anchor.rows, damping=hand.damping)
        if a is None:
            return _Partial(anchor.a, hand.Z, [_measure(level, anchor.a)], 1)
        return _Partial(a, hand.Z, [_measure(level, a)], 0)

    def _scale_hand(
        self, level: Level, hand: WeightedJacobian, anchor: Anchor, box: Box
    ) -> _Partial:
        a_p = hand.pseudo_inverse(level.T * (level.x - level.J @ anchor.a))
        scaled = self._scaling.solve(anchor.a, a_p, hand.Z, box, anchor.rows)
        if scaled is None:
            return _Partial(anchor.a, hand.Z, [0.0], 1)
        return _Partial(scaled.a, hand.Z, [scaled.c], 0)


def _project_below(
    level: Level, projection: NullSpaceProjection, above: _Partial, box: Box, rows: Rows | None
) -> _Partial:
    a = projection.solve(level, above.a, above.Z, box, rows)
    failed = a is None
    a = above.a if a is None else a
    JZ = level.T[:, np.newaxis] * (level.J @ above.Z)
    _, _, Vt = decompose(JZ)
    return _Partial(
        a,
        above.Z @ Vt[len(JZ) :].T,
        [*above.shares, _measure(level, a)],
        above.failures + failed,
    )


def _list_own_joints(moves: Sequence[Mask]) -> list[Mask]:
    """Of every level the joints that move it and no level above it."""
    own: list[Mask] = []
    taken = np.zeros_like(moves[0])
    for mask in moves:
        own.append(mask & ~taken)
        taken = taken | mask
    return own


def _stack(levels: Sequence[Level]) -> Level:
    if len(levels) == 1:
        return levels[0]
    return Level(
        np.vstack([level.J for level in levels]),
        np.concatenate([level.x for level in levels]),
        np.concatenate([level.T for level in levels]),
    )


def _is_fixed(level: Level, moves: Mask, a: Array) -> bool:
    """Whether at the optimum a (n,) of a level none of the joints that move it has a choice."""
    residual = level.T * (level.J @ a - level.x)
    if np.abs(residual).max() < _MET:
        return False
    multipliers = (level.T * residual) @ level.J
    return _are_independent(level.J[:, (np.abs(multipliers) <= _MULTIPLIER) & moves])


def _are_independent(columns: Array) -> bool:
    """Whether columns (m, k) span k dimensions, k < m."""
    if columns.shape[1] == 0:
        return True
    if columns.shape[1] >= len(columns):
        return False
    return smallest_pivot(columns.T @ columns) > _PIVOT


def _measure(level: Level, a: Array) -> float:
    """C = <T J a, T x> / <T x, T x> in [0, 1]."""
    wanted = level.T * level.x
    return share(float(wanted @ (level.T * (level.J @ a))), float(wanted @ wanted))
