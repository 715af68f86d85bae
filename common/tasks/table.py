"""The table that every task stands on: its top, and two legs on the robot's side."""

from __future__ import annotations

from dataclasses import dataclass

from common.tasks.poses import upright
from common.tasks.task import Obstacle

_HALF_THICKNESS_M = 0.025
_LEG_INSET_M = 0.06


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table of 2 m width along y.

    Args:
        top_m: Height of its top.
        centre_x_m: Its middle, along x.
        half_depth_m: Half its length along x.
    """

    top_m: float
    centre_x_m: float
    half_depth_m: float

    @property
    def obstacle(self) -> Obstacle:
        """The top as a box that robots keep away from."""
        return Obstacle("table", upright(*self._centre_m, 0.0), self._half_size_m)

    def build(self) -> str:
        """MJCF of the top and of two legs, which are only looked at."""
        half = 0.5 * (self.top_m - 2.0 * _HALF_THICKNESS_M)
        leg_x = self.centre_x_m - self.half_depth_m + _LEG_INSET_M
        legs = (
            f'<geom name="leg_{i}" type="box" size="0.03 0.03 {half:.9g}" '
            f'pos="{leg_x:.9g} {y:.9g} {half:.9g}" rgba="0.45 0.38 0.30 1" contype="0" '
            'conaffinity="0" group="2"/>'
            for i, y in enumerate((-0.94, 0.94))
        )
        top = (
            f'<geom name="table" type="box" size="{numbers(*self._half_size_m)}" '
            f'pos="{numbers(*self._centre_m)}" rgba="0.80 0.68 0.52 1"/>'
        )
        return "\n    ".join((top, *legs))

    @property
    def _half_size_m(self) -> tuple[float, float, float]:
        return (self.half_depth_m, 1.0, _HALF_THICKNESS_M)

    @property
    def _centre_m(self) -> tuple[float, float, float]:
        return (self.centre_x_m, 0.0, self.top_m - _HALF_THICKNESS_M)


def numbers(*values: float) -> str:
    """Numbers as MJCF has them."""
    return " ".join(f"{value:.9g}" for value in values)
