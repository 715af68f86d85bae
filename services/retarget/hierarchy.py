"""Two strict priorities: the hand first, the posture in what the hand leaves free."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common.se3 import Array
from services.retarget.bounds import Box
from services.retarget.nullspace import WeightedJacobian
from services.retarget.posture import PostureLevel, share
from services.retarget.program import ConvexProgram

REGULARISATION = 1e-6
"""Weight of a^T H a in level 1."""


@dataclass(frozen=True)
class Solution:
    """What the hierarchy decided for one tick.

    Args:
        a: (n,) joint velocities [rad/s, m/s].
        scaling: Shares c1 of the hand task and c2 of the posture task that are achieved.
        failures: Levels that fell back to their feasible default.
    """

    a: Array
    scaling: tuple[float, float]
    failures: int


class Hierarchy:
    """Solves the two levels under a box l <= a <= u that is never empty.

    Level 1 (project): a1 = argmin 1/2 |T (J1 a - x1)|^2 + 1/2 1e-6 a^T H a. Level 2: a = a1 + Z z
    nearest to the posture velocity x2; J1 Z = 0, so the hand never notices. When a point with
    J1 a = x1 is known, no program is solved for level 1. Every fallback is feasible.

    Args:
        H: (n,) level-1 joint weights.
        W: (n,) level-2 joint weights.
        rotation_scale_m: L of T = diag(1, 1, 1, L, L, L).
    """

    def __init__(self, *, H: Array, W: Array, rotation_scale_m: float) -> None:
        self._H = H
        self._H_root = np.sqrt(H)
        self._T = np.array([1.0, 1.0, 1.0, *[rotation_scale_m] * 3])
        self._T_column = self._T[:, np.newaxis].copy()
        self._hand_program = ConvexProgram(narrow=False)
        self._posture = PostureLevel(H=H, W=W)

    def solve(self, J1: Array, x1: Array, x2: Array, a_prev: Array, box: Box) -> Solution:
        """Joint velocities for one tick.

        Args:
            J1: (6, n) hand Jacobian, world axes.
            x1: (6,) wanted hand twist [m/s, rad/s].
            x2: (n,) wanted posture velocity.
            a_prev: (n,) velocities of the last tick.
            box: Bounds of the tick.
        """
        hand = WeightedJacobian(self._T_column * J1, self._H_root)
        Tx1 = self._T * x1
        failures = 0
        found = self._solve_exactly(hand, Tx1, x2, a_prev, box)
        if found is None:
            a1, failures = self._project(hand, Tx1, box)
            # In a corner of the box the line of one spare joint can miss it by rounding.
            found = self._posture.solve(hand.Z, a1, x2, box) or (a1, 0.0, 0)
        a, c2, failed = found
        a = box.clip(a)
        c1 = share(float(Tx1 @ (hand.TJ @ a)), float(Tx1 @ Tx1))
        return Solution(a, (c1, c2), failures + failed)

    def _solve_exactly(
        self, hand: WeightedJacobian, Tx1: Array, x2: Array, a_prev: Array, box: Box
    ) -> tuple[Array, float, int] | None:
        """Both levels without a program for the hand, if a feasible a with J1 a = x1 is known.

        Tried are the point of least norm and, with several spare joints, the one nearest to the
        last velocity. Near a singularity J1 a is the damped x1.
        """
        a_least = hand.pseudo_inverse(Tx1)
        found = self._posture.solve(hand.Z, a_least, x2, box)
        if found is None and hand.Z.shape[1] > 1:
            a_near = a_least + hand.Z @ (hand.Z.T @ (self._H * (a_prev - a_least)))
            found = self._posture.solve(hand.Z, a_near, x2, box)
        return found

    def _project(self, hand: WeightedJacobian, Tx1: Array, box: Box) -> tuple[Array, int]:
        """Feasible velocities (n,) whose hand twist is nearest to the wanted one, and failures."""
        P = hand.TJ.T @ hand.TJ
        P.flat[:: len(P) + 1] += (REGULARISATION + hand.damping) * self._H
        a1 = self._hand_program.solve(
            P, -(Tx1 @ hand.TJ), x_l=np.array(box.lower), x_u=np.array(box.upper)
        )
        if a1 is None:
            # The nearest to a full stop.
            return box.clip(np.zeros(len(P))), 1
        return box.clip(a1), 0
