"""What the hierarchy decides for one tick, and how shares of levels are measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from common.se3 import Array
from services.retarget.level import Level
from services.retarget.posture import share


class Solution(NamedTuple):
    """Joint velocities of one tick.

    Args:
        a: (n,) [rad/s, m/s].
        scaling: Share of every level that is achieved, the posture's last.
        failures: Levels that fell back to their feasible default.
    """

    a: Array
    scaling: list[float]
    failures: int


def measure_level(level: Level, a: Array) -> float:
    """Share c = <T J a, T x> / <T x, T x>, in [0, 1], of a level that velocities a achieve."""
    wanted = level.T * level.x
    return share(float(wanted @ (level.T * (level.J @ a))), float(wanted @ wanted))


def stack_levels(levels: Sequence[Level]) -> Level:
    """Several levels as one."""
    if len(levels) == 1:
        return levels[0]
    return Level(
        np.concatenate([level.J for level in levels]),
        np.concatenate([level.x for level in levels]),
        np.concatenate([level.T for level in levels]),
    )
