"""How a person shelves the cup."""

from __future__ import annotations

import math

import numpy as np

from common.calibration.four_bar import driver_rad, pad_centre_x_m
from common.se3 import Array, exp3, invert, make_pose
from common.tasks.cup_scene import (
    CABINET_FLOOR_M,
    CUP_HALF_HEIGHT_M,
    HANDLE_GRIP_M,
    HANDLE_WIDTH_M,
)
from common.tasks.poses import norm, shifted, tilt_of, yaw_of
from common.tasks.staged_script import StagedScript
from common.tasks.task import DemonstratorView, Waypoint

STANDING_Z_M = CABINET_FLOOR_M + CUP_HALF_HEIGHT_M
"""Height of the cup's centre in the cabinet's frame when it stands there: -0.100 m."""
PLACE_Y_M = 0.05
"""Where the cup is put in the cabinet's frame: the front half, as near hands reach it."""

_MOST_GRASPS = 3
_KNOCKED_OVER_RAD = math.radians(20.0)


class CupScript(StagedScript):
    """Grasp the handle, lift, draw back, go round the door, insert, lower, release, retreat.

    The hand looks at the cup's middle: fingers on both sides of the handle, tips before the wall.
    Everything after the grasp is planned for the cup as it really hangs in the hand.
    """

    def __init__(self, random: np.random.Generator) -> None:
        super().__init__()
        self._pitch_rad = math.radians(random.uniform(16.0, 28.0))
        self._turn_rad = math.radians(random.uniform(-6.0, 6.0))
        self._depth_m = random.uniform(-0.002, 0.008)
        self._height_m = random.uniform(-0.004, 0.008)
        self._lift_m = random.uniform(0.11, 0.14)
        self._place_y_m = PLACE_Y_M + random.uniform(-0.01, 0.01)
        self._place_turn_rad = math.radians(random.uniform(0.0, 15.0))
        self._look_s = random.uniform(0.0, 0.3)
        self._grasps = 0

    def _approach(self, view: DemonstratorView) -> list[Waypoint]:
        self._grasps += 1
        self._stage = self._lift
        T_grasp = self._grasp_pose(view.objects["cup"])
        return [
            Waypoint("line up", shifted(T_grasp, back=0.12), grasp=False, look_s=self._look_s),
            Waypoint("reach", T_grasp, grasp=False, speed_m_s=0.12, wait_s=0.2),
            Waypoint("close", None, grasp=True, wait_s=0.8),
        ]

    def _lift(self, view: DemonstratorView) -> list[Waypoint]:
        if not self._holds_cup(view):
            return self._recover(view)
        self._stage = self._carry
        T_lift = shifted(view.T_world_tool, up=self._lift_m)
        return [
            Waypoint("lift", T_lift, grasp=True, speed_m_s=0.2),
            Waypoint("draw back", shifted(T_lift, back=0.08), grasp=True, look_s=0.2),
        ]

    def _carry(self, view: DemonstratorView) -> list[Waypoint]:
        if not self._holds_cup(view):
            return self._recover(view)
        self._stage = self._insert
        around = self._tool_for_cup(view, x=0.20, y=0.52, above=0.05, turn=0.7)
        before = self._tool_for_cup(view, x=0.0, y=0.36, above=0.04)
        return [
            Waypoint("go round the door", around, grasp=True),
            Waypoint("stop before the cabinet", before, grasp=True, look_s=0.3),
        ]

    def _insert(self, view: DemonstratorView) -> list[Waypoint]:
        if not self._holds_cup(view):
            return self._recover(view)
        self._stage = self._lower
        T_above = self._tool_for_cup(view, x=0.0, y=self._place_y_m, above=0.03)
        return [Waypoint("insert", T_above, grasp=True, speed_m_s=0.2, look_s=0.3)]

    def _lower(self, view: DemonstratorView) -> list[Waypoint]:
        if not self._holds_cup(view):
            return self._recover(view)
        self._stage = self._retreat
        T_stand = self._tool_for_cup(view, x=0.0, y=self._place_y_m, above=0.001)
        return [
            Waypoint("lower", T_stand, grasp=True, speed_m_s=0.08, wait_s=0.3),
            Waypoint("open", None, grasp=False, wait_s=0.6),
        ]

    def _retreat(self, view: DemonstratorView) -> list[Waypoint]:
        self._stage = self._inspect
        T_back = shifted(view.T_world_tool, back=0.17)
        return [Waypoint("retreat", T_back, grasp=False, speed_m_s=0.2, wait_s=0.8)]

    def _inspect(self, view: DemonstratorView) -> list[Waypoint]:
        """Try again when the cup does not stand on the shelf, as a person would."""
        T_cabinet_cup = invert(view.objects["cabinet"]) @ view.objects["cup"]
        x, y, z = T_cabinet_cup[:3, 3].tolist()
        if abs(x) <= 0.15 and -0.05 <= y <= 0.09 and abs(z - STANDING_Z_M) <= 0.01:
            self._done = True
            return []
        return self._recover(view)

    def _recover(self, view: DemonstratorView) -> list[Waypoint]:
        """Let go, draw back and start over; give up after three grasps, or when the cup lies."""
        if self._grasps >= _MOST_GRASPS or tilt_of(view.objects["cup"]) > _KNOCKED_OVER_RAD:
            self._done = True
            return []
        self._stage = self._approach
        return [
            Waypoint("let go", None, grasp=False, wait_s=0.8),
            Waypoint("back off", shifted(view.T_world_tool, back=0.15), grasp=False),
        ]

    def _grasp_pose(self, T_world_cup: Array) -> Array:
        """Tool pose with the handle between the pads: fingers at the cup, pitched down."""
        heading = yaw_of(T_world_cup) - 0.5 * math.pi + self._turn_rad
        R_world_tool = exp3([0.0, 0.0, heading]) @ exp3([0.0, self._pitch_rad, 0.0])
        grip = [0.0, HANDLE_GRIP_M + self._depth_m, self._height_m, 1.0]
        reach = pad_centre_x_m(driver_rad(HANDLE_WIDTH_M))
        p_world_grip = (T_world_cup @ grip)[:3]
        return make_pose(R_world_tool, p_world_grip - R_world_tool @ [reach, 0.0, 0.0])

    def _tool_for_cup(
        self, view: DemonstratorView, *, x: float, y: float, above: float, turn: float = 0.0
    ) -> Array:
        """Tool pose that has the cup, as it hangs in the hand, upright at a place of the cabinet.

        The hand heads into the cabinet, turned by the demonstrator's habit plus `turn`.
        """
        T_cabinet, T_cup = view.objects["cabinet"], view.objects["cup"]
        heading = yaw_of(T_cabinet) - 0.5 * math.pi + self._place_turn_rad + turn
        yaw = yaw_of(T_cup) + heading - yaw_of(view.T_world_tool)
        p_world_cup = (T_cabinet @ [x, y, STANDING_Z_M + above, 1.0])[:3]
        T_tool_cup = invert(view.T_world_tool) @ T_cup
        return make_pose(exp3([0.0, 0.0, yaw]), p_world_cup) @ invert(T_tool_cup)

    def _holds_cup(self, view: DemonstratorView) -> bool:
        """Whether the handle is still between the pads: near them, and they are apart."""
        T_tool_cup = invert(view.T_world_tool) @ view.objects["cup"]
        p_tool_grip = (T_tool_cup @ [0.0, HANDLE_GRIP_M, 0.0, 1.0])[:3]
        reach = pad_centre_x_m(driver_rad(HANDLE_WIDTH_M))
        near = norm(p_tool_grip - [reach, 0.0, 0.0]) < 0.05
        return near and view.opening_m > 0.5 * HANDLE_WIDTH_M
