"""Positions of a robot and the steps between them: joints, or the pose of a free hand."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

from common.errors import InvalidValue
from common.messages.base import has_unit_quaternion
from common.se3 import Quaternion, exp_quat, multiply, relative_rotation


class Space(Protocol):
    """Arithmetic of positions. A step has one number per velocity.

    Lists, not arrays: for the few numbers of a robot they are faster.
    """

    def check(self, positions: Sequence[float]) -> None:
        """Refuse what is no position.

        Raises:
            InvalidValue: It is none.
        """
        ...

    def subtract(self, to: Sequence[float], origin: Sequence[float]) -> list[float]:
        """The step from one position to another."""
        ...

    def add(self, positions: Sequence[float], step: Sequence[float]) -> list[float]:
        """The position a step away."""
        ...


class JointSpace:
    """Positions are a vector."""

    def check(self, positions: Sequence[float]) -> None:
        """Every vector is a position."""

    def subtract(self, to: Sequence[float], origin: Sequence[float]) -> list[float]:
        """Difference."""
        return [a - b for a, b in zip(to, origin, strict=True)]

    def add(self, positions: Sequence[float], step: Sequence[float]) -> list[float]:
        """Sum."""
        return [a + b for a, b in zip(positions, step, strict=True)]


class PoseSpace:
    """Positions are `[x, y, z, qw, qx, qy, qz]`; steps are in world axes, turns in the hand's."""

    def check(self, positions: Sequence[float]) -> None:
        """Refuse a quaternion that is not normalised.

        Raises:
            InvalidValue: It is not.
        """
        if not has_unit_quaternion(positions):
            raise InvalidValue("RobotCommand quaternion", list(positions[3:]), "length 1")

    def subtract(self, to: Sequence[float], origin: Sequence[float]) -> list[float]:
        """Difference of the points, then log(R_origin^T R_to)."""
        x, y, z, *_ = to
        x0, y0, z0, *_ = origin
        turn = relative_rotation(_quaternion(origin), _quaternion(to))
        return [x - x0, y - y0, z - z0, *turn]

    def add(self, positions: Sequence[float], step: Sequence[float]) -> list[float]:
        """Sum of the points, then R exp(turn), normalised."""
        x, y, z, *_ = positions
        dx, dy, dz, *turn = step
        turned = multiply(_quaternion(positions), exp_quat(turn))
        length = math.hypot(*turned)
        return [x + dx, y + dy, z + dz, *(value / length for value in turned)]


def _quaternion(positions: Sequence[float]) -> Quaternion:
    _, _, _, w, x, y, z = positions
    return w, x, y, z
