"""Level by level: the general way to a solution, one program each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from common.se3 import Array
from services.retarget.anchor import Anchor, AnchorLevel
from services.retarget.at_bounds import AtBounds
from services.retarget.bounds import Box
from services.retarget.lapack import decompose
from services.retarget.level import Level, LevelShape
from services.retarget.nullspace import WeightedJacobian
from services.retarget.posture import PostureLevel
from services.retarget.program import ProgramMaker
from services.retarget.projection import NullSpaceProjection, RowProjection
from services.retarget.rows import Rows
from services.retarget.scaling import Scaling
from services.retarget.solution import Solution, measure_level

Mode = Literal["project", "scale"]


class _Partial(NamedTuple):
    """Solution (n,) of the levels so far, what they leave free (n, k), their shares, failures."""

    a: Array
    Z: Array
    shares: list[float]
    failures: int


class ByLevels:
    """Level 0, then each level in what those above leave free, the posture last.

    Args:
        H: (n,) level-1 joint weights.
        shapes: Of all levels but the posture, the hand first.
        mode: How level 1 treats a twist that is not possible.
        posture: The last level.
        at_bounds: Solves level 1 alone where there are no rows.
        make_program: What solves programs.
    """

    def __init__(
        self,
        *,
        H: Array,
        shapes: Sequence[LevelShape],
        mode: Mode,
        posture: PostureLevel,
        at_bounds: AtBounds,
        make_program: ProgramMaker,
    ) -> None:
        n, rows = len(H), [shape.rows for shape in shapes]
        self._mode = mode
        self._posture = posture
        self._at_bounds = at_bounds
        self._anchor = AnchorLevel(n=n, make_program=make_program)
        self._row_projection = RowProjection(H=H, make_program=make_program)
        self._scaling = Scaling(n=n, spare=n - rows[0], make_program=make_program)
        self._below = [
            NullSpaceProjection(H=H, spare=n - sum(rows[:i]), make_program=make_program)
            for i in range(1, len(rows))
        ]
        self.held_by_rows = False
        """Whether the last solution stands at a Cartesian row."""

    def solve(
        self,
        levels: Sequence[Level],
        y: Array,
        box: Box,
        rows: Rows | None,
        hand: WeightedJacobian,
        a1: Array | None,
    ) -> Solution:
        """Joint velocities for one tick.

        Args:
            levels: All but the posture.
            y: (n,) optimum of the posture alone.
            box: Bounds.
            rows: Cartesian rows, or None when nothing is near.
            hand: Decomposition of level 1.
            a1: (n,) solution of level 1 where it is known, in box and rows.
        """
        anchor = self._anchor.solve(box, rows)
        if a1 is not None:
            found = _Partial(a1, hand.Z, [measure_level(levels[0], a1)], 0)
        elif self._mode == "scale":
            found = self._scale(levels[0], hand, anchor, box)
        else:
            found = self._project(levels[0], hand, anchor, box)
        for level, projection in zip(levels[1:], self._below, strict=True):
            found = _project_below(level, projection, found, box, anchor.rows)
        posture = self._posture.solve(found.Z, found.a, y, box, anchor.rows)
        a = box.clip(posture.a)
        self.held_by_rows = anchor.rows is not None and not anchor.rows.leave_room(a)
        failures = anchor.failures + found.failures + posture.failures
        return Solution(a, [*found.shares, posture.c], failures)

    def _project(self, level: Level, hand: WeightedJacobian, anchor: Anchor, box: Box) -> _Partial:
        if hand.damping > 0.0:
            # The damped motion is the answer wherever it is possible, not only the projection's.
            a = hand.pseudo_inverse(level.T * level.x)
            if box.contains(a) and (anchor.rows is None or anchor.rows.allow(a)):
                return _Partial(a, hand.Z, [measure_level(level, a)], 0)
        if anchor.rows is None:
            a = self._at_bounds.project_first(level, anchor.a, box, damping=hand.damping)
        else:
            a = self._row_projection.solve(level, box, anchor.rows, damping=hand.damping)
        if a is None:
            return _Partial(anchor.a, hand.Z, [measure_level(level, anchor.a)], 1)
        return _Partial(a, hand.Z, [measure_level(level, a)], 0)

    def _scale(self, level: Level, hand: WeightedJacobian, anchor: Anchor, box: Box) -> _Partial:
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
    _, _, Vt = decompose(level.T[:, np.newaxis] * (level.J @ above.Z))
    Z = above.Z @ Vt[len(level.x) :].T
    return _Partial(a, Z, [*above.shares, measure_level(level, a)], above.failures + failed)
