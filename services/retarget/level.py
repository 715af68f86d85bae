"""A task of the hierarchy: some velocity that joint velocities should produce."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from common.se3 import Array

Mask: TypeAlias = npt.NDArray[np.bool_]


class Level(NamedTuple):
    """J a = x, as well as possible in the metric |T (J a - x)|.

    Args:
        J: (m, n) Jacobian.
        x: (m,) wanted velocity.
        T: (m,) weight of each row, so that rotations and translations can be compared.
    """

    J: Array
    x: Array
    T: Array


class LevelShape(NamedTuple):
    """What stays the same about a level from tick to tick.

    Args:
        rows: m.
        moves: (n,) mask of the joints whose column of J can be other than zero.
    """

    rows: int
    moves: Mask
