"""Strict priorities: walls, then the hand, then what else is wanted, then the posture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from common.se3 import Array
from services.retarget.at_bounds import AtBounds
from services.retarget.bounds import Box
from services.retarget.by_levels import ByLevels, Mode
from services.retarget.exact import ExactSolver, Unbounded
from services.retarget.level import Level, LevelShape
from services.retarget.nullspace import DAMPED_BELOW, WeightedJacobian, is_regular
from services.retarget.posture import PostureLevel
from services.retarget.program import PIQP, make_program
from services.retarget.rows import Rows
from services.retarget.solution import Solution, stack_levels


class Hierarchy:
    """Solves all levels in a box that is never empty, whatever the levels want.

    Level 0 keeps the Cartesian rows, with the least slack. Level 1 moves the hand: `project` as
    near to the wanted twist as possible, `scale` along it as far as possible. Further levels and
    the posture move within what is left, J1 Z = 0, so the hand never notices them. Every fallback
    is feasible.

    Three ways lead to the solution, from cheap to general: all levels met exactly (`ExactSolver`,
    no program); at the bounds, where nothing of what moves a level is left free (`AtBounds`, one
    small program each); level by level (`ByLevels`). Which of them is taken never changes the hand.

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
        rows = sum(shape.rows for shape in shapes)
        posture = PostureLevel(H=H, W=W, spare=len(H) - rows, make_program=program)
        D = 1.0 / posture.weights
        self._H_root = np.sqrt(H)
        self._mode = mode
        self._posture = posture
        self._exact = ExactSolver(D=D, rows=rows)
        self._at_bounds = AtBounds(H=H, shapes=shapes, posture=posture, make_program=program)
        self._by_levels = ByLevels(
            H=H,
            shapes=shapes,
            mode=mode,
            posture=posture,
            at_bounds=self._at_bounds,
            make_program=program,
        )
        # s_min(T J1 H^-1/2)^2 >= kappa / trace((T J1 D J1' T)^-1): no need of its SVD below this.
        self._safe_trace = float((1.0 / (H * D)).min()) / DAMPED_BELOW**2
        self._was_met = True

    def solve(self, levels: Sequence[Level], x: Array, box: Box, rows: Rows | None) -> Solution:
        """Joint velocities for one tick.

        Args:
            levels: The hand (six rows), then others.
            x: (n,) wanted posture velocity.
            box: Bounds of the tick.
            rows: Cartesian rows, or None when nothing is near.
        """
        y = self._posture.optimum(x)
        stack = stack_levels(levels)
        start = self._exact.solve_unbounded(stack.J, stack.x, stack.T, y)
        hand = None
        if start.inverse_trace > self._safe_trace and not self._is_regular(levels[0]):
            hand = self._decompose(levels[0])
        solution, a1 = None, None
        if hand is None or hand.damping == 0.0:
            solution = self._solve_exactly(stack, y, start, box, rows, len(levels))
            self._was_met = solution is not None
            # While a row holds the hand back, the bounds alone do not decide.
            if solution is None and self._mode == "project" and not self._by_levels.held_by_rows:
                solution, a1, met = self._at_bounds.solve(levels, y, box, rows)
                self._was_met = met
        if solution is None:
            hand = hand or self._decompose(levels[0])
            solution = self._by_levels.solve(levels, y, box, rows, hand, a1)
        self._exact.remember(solution.a, box)
        return solution

    def _is_regular(self, level: Level) -> bool:
        return is_regular(level.T[:, np.newaxis] * level.J, self._H_root)

    def _decompose(self, level: Level) -> WeightedJacobian:
        return WeightedJacobian(level.T[:, np.newaxis] * level.J, self._H_root)

    def _solve_exactly(
        self, stack: Level, y: Array, start: Unbounded, box: Box, rows: Rows | None, levels: int
    ) -> Solution | None:
        """All levels met."""
        # While the hand is held back by the bounds, searching costs more than it brings.
        a = self._exact.solve(stack.J, stack.x, y, start, box, search=self._was_met)
        if a is None or not (rows is None or rows.allow(a)):
            return None
        posture = 1.0
        if a is not start.a:
            least = self._exact.solve_unbounded(stack.J, stack.x, stack.T, 0.0 * y).a
            posture = self._posture.measure(a, start.a, least)
        return Solution(a, [1.0] * levels + [posture], 0)
