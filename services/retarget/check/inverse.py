"""Inverse kinematics: joint positions that put the tool at a pose, if there are any."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import pinocchio as pin

from common.se3 import Array
from services.retarget.check.postures import draw_posture
from services.retarget.robot_model import RobotModel

REACHED_M = 0.003
REACHED_RAD = 0.03

_ITERATIONS = 80
_PATIENCE = 12
"""Iterations within which the error must have shrunk by a tenth."""
_STEP = 0.4
"""Largest step of any joint [rad, m]."""
_AT_LIMIT = 1e-9
_DAMPING = 1e-4


class InverseKinematics:
    """Damped least squares with joint limits, from several postures.

    With the error e = (p* - p, log3(R* R^T)) and the hand Jacobian J of the joints that are free,

        dq = J^T (J J^T + (e^T e / 2 + 1e-4) I)^-1 e

    A joint at its limit is free unless J^T e presses it further out. The damping is that of
    T. Sugihara, "Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method",
    IEEE T-RO 27 (2011).

    Args:
        model: The robot.
        starts: Random postures that are tried after the given ones.
    """

    def __init__(self, model: RobotModel, *, starts: int) -> None:
        self._model = model
        random = np.random.default_rng(3)
        joints = model.spec.joints
        self._starts = [
            np.array([joint.start for joint in joints]),
            np.array([joint.bias for joint in joints]),
            *(draw_posture(model.lower, model.upper, random) for _ in range(starts)),
        ]

    def solve(self, T_world_tool: Array, near: Iterable[Array] = ()) -> Array | None:
        """Joint positions (n,) within 3 mm and 0.03 rad of a tool pose (4, 4), or None.

        Args:
            T_world_tool: Wanted pose.
            near: Postures (n,) that are tried first.
        """
        for start in (*near, *self._starts):
            q = self.descend(T_world_tool, start)
            if q is not None:
                return q
        return None

    def descend(self, T_world_tool: Array, start: Array) -> Array | None:
        """The same from one posture (n,)."""
        model, q = self._model, start.copy()
        best, patience = math.inf, _PATIENCE
        for _ in range(_ITERATIONS):
            T, J = model.compute_hand(q)
            e = np.concatenate(
                [T_world_tool[:3, 3] - T[:3, 3], pin.log3(T_world_tool[:3, :3] @ T[:3, :3].T)]
            )
            x, y, z, a, b, c = e.tolist()
            if math.hypot(x, y, z) <= REACHED_M and math.hypot(a, b, c) <= REACHED_RAD:
                return q
            squared = float(e @ e)
            patience -= 1
            if squared < 0.8 * best:
                best, patience = squared, _PATIENCE
            elif patience <= 0:
                return None
            q = self._step(q, J, e, squared)
        return None

    def _step(self, q: Array, J: Array, e: Array, squared: float) -> Array:
        lower, upper = self._model.lower, self._model.upper
        downhill = J.T @ e
        blocked = ((q <= lower + _AT_LIMIT) & (downhill < 0.0)) | (
            (q >= upper - _AT_LIMIT) & (downhill > 0.0)
        )
        J_free = np.where(blocked, 0.0, J)
        A = J_free @ J_free.T
        A.flat[::7] += 0.5 * squared + _DAMPING
        dq = J_free.T @ np.linalg.solve(A, e)
        dq *= min(1.0, _STEP / max(float(np.abs(dq).max()), 1e-12))
        return np.minimum(np.maximum(q + dq, lower), upper)
