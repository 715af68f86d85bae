"""Where the hand must get in the three tasks: objects, points on them, turns of the hand.

Ranges of the objects follow the simulation of the paper. The shelf stands 0.12 m nearer to the
world's origin than there, as every robot reaches it then (the layout `reachable`). The ranges of
the hand are our own choice: what holds the object without touching what is around it.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from common.calibration.four_bar import driver_rad, pad_centre_x_m
from common.se3 import Array, exp3, make_pose
from common.tasks.cup_scene import HANDLE_GRIP_M, HANDLE_WIDTH_M
from common.tasks.ladle_scene import HANDLE_HALF_WIDTH_M
from common.tasks.lid import BAR_HEIGHT_M, BAR_WIDTH_M
from common.tasks.poses import upright, yaw_of

Range: TypeAlias = tuple[float, float]
"""Least and largest value."""


@dataclass(frozen=True, kw_only=True)
class HandTurn:
    """How the hand is turned: pitched down, and away from the heading that fits best [rad]."""

    pitch_rad: float
    yaw_rad: float


@dataclass(frozen=True, kw_only=True)
class Region:
    """All grasps of one step of a task.

    An upright object stands anywhere in a box, turned about the vertical. The hand comes level or
    from above, its fingers' heading in the object's frame is `heading_rad` plus a turn.
    """

    task: str
    name: str
    """The step: grasp or place."""
    x_m: Range
    y_m: Range
    z_m: float
    """Height of the object's origin in the world."""
    yaw_rad: Range
    """The object's turn about the vertical."""
    point_m: tuple[float, float, float]
    """Point of the object that the hand goes to, in the object's frame."""
    before_m: float = 0.0
    """How far the pads stay before that point, along the heading."""
    heading_rad: float = 0.0
    turn_rad: Range
    """How far the hand may be turned away from its heading, either way."""
    pitch_rad: Range
    """How far down the fingers point."""
    width_m: float
    """What is between the pads; decides how far ahead of the tool frame they are."""

    def list_objects(self) -> list[Array]:
        """Poses (4, 4) of the object in the world: all corners of its ranges, and their middle."""
        ranges = (self.x_m, self.y_m, self.yaw_rad)
        middle = tuple(0.5 * (least + largest) for least, largest in ranges)
        corners = itertools.product(*(dict.fromkeys(each) for each in ranges))
        return [upright(x, y, self.z_m, yaw) for x, y, yaw in dict.fromkeys((middle, *corners))]

    def list_turns(self) -> list[HandTurn]:
        """Three pitches times three turns, the middle ones first."""
        return [
            HandTurn(pitch_rad=pitch, yaw_rad=yaw)
            for pitch, yaw in itertools.product(
                _middle_first(self.pitch_rad), _middle_first(self.turn_rad)
            )
        ]

    def place_tool(self, T_world_object: Array, turn: HandTurn) -> Array:
        """T_world_tool (4, 4) that has the pads where they belong.

        With the heading h in the world: R = Rz(h) Ry(pitch), p = p_point - before (cos h, sin h, 0)
        - R (l, 0, 0), where the pads are l ahead of the tool frame.
        """
        heading = yaw_of(T_world_object) + self.heading_rad + turn.yaw_rad
        R_world_tool = exp3([0.0, 0.0, heading]) @ exp3([0.0, turn.pitch_rad, 0.0])
        p_world_pads = (T_world_object @ [*self.point_m, 1.0])[:3] - self.before_m * np.array(
            [math.cos(heading), math.sin(heading), 0.0]
        )
        ahead = R_world_tool @ [pad_centre_x_m(driver_rad(self.width_m)), 0.0, 0.0]
        return make_pose(R_world_tool, p_world_pads - ahead)


def _middle_first(bounds: Range) -> list[float]:
    least, largest = bounds
    return list(dict.fromkeys((0.5 * (least + largest), least, largest)))


def _deg(least: float, largest: float) -> Range:
    return math.radians(least), math.radians(largest)


_BAR_M = (0.0, 0.0, BAR_HEIGHT_M - 0.004)
"""Where the lid's bar is taken, in the lid's frame."""

_LID = (
    Region(
        task="lid",
        name="grasp",
        x_m=(0.60, 0.65),
        y_m=(-0.33, -0.17),
        z_m=0.70,
        yaw_rad=_deg(-20.0, 20.0),
        point_m=_BAR_M,
        turn_rad=(0.0, 0.0),
        pitch_rad=_deg(25.0, 55.0),
        width_m=BAR_WIDTH_M,
    ),
    # The seated lid. It may be turned as it lay on the table.
    Region(
        task="lid",
        name="place",
        x_m=(0.67, 0.69),
        y_m=(-0.05, 0.05),
        z_m=0.81,
        yaw_rad=(0.0, 0.0),
        point_m=_BAR_M,
        turn_rad=_deg(-20.0, 20.0),
        pitch_rad=_deg(25.0, 55.0),
        width_m=BAR_WIDTH_M,
    ),
)

_CUP = (
    # The handle is on the cup's +y; the fingers point at the cup, one pad on each face of the ring.
    Region(
        task="cup",
        name="grasp",
        x_m=(0.5425, 0.5825),
        y_m=(0.08, 0.12),
        z_m=0.705,
        yaw_rad=_deg(117.0, 153.0),
        point_m=(0.0, HANDLE_GRIP_M, 0.0),
        heading_rad=-0.5 * math.pi,
        turn_rad=_deg(-10.0, 10.0),
        pitch_rad=_deg(0.0, 40.0),
        width_m=HANDLE_WIDTH_M,
    ),
    # The cabinet opens at its +y. The cup stands 5 cm before its middle, its handle to the hand.
    Region(
        task="cup",
        name="place",
        x_m=(0.768, 0.843),
        y_m=(-0.726, -0.526),
        z_m=0.875,
        yaw_rad=_deg(54.0, 72.0),
        point_m=(0.0, 0.05, -0.10),
        before_m=HANDLE_GRIP_M,
        heading_rad=-0.5 * math.pi,
        turn_rad=_deg(-45.0, 45.0),
        pitch_rad=_deg(0.0, 40.0),
        width_m=HANDLE_WIDTH_M,
    ),
)

_LADLE = (
    # The object is the pot that the ladle leans on, turned with the ladle. The shaft rises 51 deg
    # away from the robot; the handle is held 34 mm nearer to the finger tips than the pads' middle.
    Region(
        task="ladle",
        name="grasp",
        x_m=(0.60, 0.60),
        y_m=(0.18, 0.42),
        z_m=0.645,
        yaw_rad=_deg(7.0, 37.0),
        point_m=(-0.160, 0.0, 0.058),
        before_m=0.031,
        turn_rad=_deg(-10.0, 10.0),
        pitch_rad=_deg(20.0, 40.0),
        width_m=2.0 * HANDLE_HALF_WIDTH_M,
    ),
    # The case, its long side away from the robot. The handle comes to its near end.
    Region(
        task="ladle",
        name="place",
        x_m=(0.5625, 0.5625),
        y_m=(-0.42, -0.38),
        z_m=0.635,
        yaw_rad=_deg(67.5, 112.5),
        point_m=(0.0, 0.06, 0.088),
        before_m=0.014,
        heading_rad=-0.5 * math.pi,
        turn_rad=_deg(-5.0, 5.0),
        pitch_rad=_deg(60.0, 72.0),
        width_m=2.0 * HANDLE_HALF_WIDTH_M,
    ),
)

REGIONS: tuple[Region, ...] = (*_LID, *_CUP, *_LADLE)
"""Every region of every task, in the order of the steps."""
