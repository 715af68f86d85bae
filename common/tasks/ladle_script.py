"""How a person puts the ladle away."""

from __future__ import annotations

import math

import numpy as np

from common.calibration.four_bar import driver_rad, pad_centre_x_m
from common.se3 import Array, exp3, invert, make_pose
from common.tasks.ladle_scene import (
    CASE_FLOOR_M,
    HANDLE_HALF_LENGTH_M,
    HANDLE_HALF_WIDTH_M,
    LYING_RAD,
    is_put_away,
)
from common.tasks.poses import norm, shifted
from common.tasks.staged_script import StagedScript
from common.tasks.task import DemonstratorView, Waypoint

_PADS_M = pad_centre_x_m(driver_rad(2.0 * HANDLE_HALF_WIDTH_M))
_TOWARDS_TIPS_M = 0.034
"""The handle is held near the finger tips, so that they need not go into the case much."""
_LEAST_PITCH_RAD, _LARGEST_PITCH_RAD = math.radians(20.0), math.radians(75.0)
_HANDLE_Y_M = 0.060
"""Where the handle's middle is laid along the case: the ladle's middle is then in its middle."""
_MOST_GRASPS = 3


class LadleScript(StagedScript):
    """Grasp the handle, lift the scoop out, carry, measure, correct, lay down, release, retreat.

    Everything after the grasp is planned for the ladle as it really lies in the hand.
    """

    def __init__(self, random: np.random.Generator) -> None:
        super().__init__()
        self._across_rad = math.radians(random.uniform(72.0, 80.0))
        self._along_handle_m = random.uniform(-0.008, 0.008)
        self._depth_m = _PADS_M + _TOWARDS_TIPS_M + random.uniform(-0.004, 0.002)
        self._hover_m = random.uniform(0.07, 0.10)
        self._lift_m = random.uniform(0.12, 0.16)
        self._above_case_m = random.uniform(0.08, 0.11)
        self._handle_y_m = _HANDLE_Y_M + random.uniform(-0.010, 0.010)
        self._look_s = random.uniform(0.0, 0.3)
        self._grasps = 0

    def _approach(self, view: DemonstratorView) -> list[Waypoint]:
        self._grasps += 1
        self._stage = self._lift
        T_grasp = self._grasp_pose(view.objects["ladle"])
        return [
            Waypoint("hover", _drawn_back(T_grasp, self._hover_m), False, look_s=self._look_s),
            Waypoint("reach", T_grasp, grasp=False, speed_m_s=0.15, wait_s=0.2),
            Waypoint("close", None, grasp=True, wait_s=0.8),
        ]

    def _lift(self, view: DemonstratorView) -> list[Waypoint]:
        """Straight up: the shaft lies on the rim and the scoop hangs behind it."""
        self._stage = self._carry
        T_up = shifted(view.T_world_tool, up=self._lift_m)
        return [Waypoint("lift", T_up, grasp=True, speed_m_s=0.2, look_s=0.3)]

    def _carry(self, view: DemonstratorView) -> list[Waypoint]:
        if not self._holds_ladle(view):
            return self._recover(view)
        self._stage = self._correct
        T_above = self._tool_to_lay(view, above_m=self._above_case_m)
        return [Waypoint("carry", T_above, grasp=True, look_s=0.3)]

    def _correct(self, view: DemonstratorView) -> list[Waypoint]:
        if not self._holds_ladle(view):
            return self._recover(view)
        self._stage = self._lay
        T_above = self._tool_to_lay(view, above_m=0.05)
        return [Waypoint("correct", T_above, grasp=True, speed_m_s=0.15, look_s=0.3)]

    def _lay(self, view: DemonstratorView) -> list[Waypoint]:
        self._stage = self._retreat
        T_lay = self._tool_to_lay(view, above_m=0.004)
        return [
            Waypoint("lay", T_lay, grasp=True, speed_m_s=0.1, wait_s=0.2),
            Waypoint("open", None, grasp=False, wait_s=0.6),
        ]

    def _retreat(self, view: DemonstratorView) -> list[Waypoint]:
        self._stage = self._inspect
        T_back = _drawn_back(view.T_world_tool, 0.12)
        return [Waypoint("retreat", T_back, grasp=False, speed_m_s=0.2, wait_s=0.8)]

    def _inspect(self, view: DemonstratorView) -> list[Waypoint]:
        """Try again when the ladle does not lie in the case, as a person would."""
        if is_put_away(invert(view.objects["case"]) @ view.objects["ladle"]):
            self._done = True
            return []
        return self._recover(view)

    def _recover(self, view: DemonstratorView) -> list[Waypoint]:
        """Open, go up and start over; give up after three grasps."""
        if self._grasps >= _MOST_GRASPS:
            self._done = True
            return []
        self._stage = self._approach
        return [
            Waypoint("let go", None, grasp=False, wait_s=0.8),
            Waypoint("back up", shifted(view.T_world_tool, up=0.08), grasp=False),
        ]

    def _grasp_pose(self, T_world_ladle: Array) -> Array:
        """Tool pose with the handle between the pads, fingers at a steep angle to the shaft.

        The hand is turned about the axis on which the pads close until its fingers make the
        demonstrator's angle with the shaft, whether the ladle leans or lies.
        """
        R_world_level = _level_hand(T_world_ladle[:3, :3])
        forward, _, upward = (R_world_level.T @ T_world_ladle[:3, 2]).tolist()
        rise = math.atan2(math.copysign(upward, forward * upward), abs(forward))
        pitch = min(max(self._across_rad - rise, _LEAST_PITCH_RAD), _LARGEST_PITCH_RAD)
        R_world_tool = R_world_level @ exp3([0.0, pitch, 0.0])
        p_world_grip = (T_world_ladle @ [0.0, 0.0, self._along_handle_m, 1.0])[:3]
        return make_pose(R_world_tool, p_world_grip - R_world_tool @ [self._depth_m, 0.0, 0.0])

    def _tool_to_lay(self, view: DemonstratorView, *, above_m: float) -> Array:
        """Tool pose that lays the ladle, as it lies in the hand, along the case.

        The shaft is put along the case, the axis on which the pads close is put level; which side
        of the ladle is down follows from the hand.
        """
        T_world_case = view.objects["case"]
        T_tool_ladle = invert(view.T_world_tool) @ view.objects["ladle"]
        # Away from the robot or towards it, as the ladle happens to be held.
        way = math.copysign(1.0, float(T_tool_ladle[2, 2]))
        shaft = np.array([0.0, -way * math.cos(LYING_RAD), math.sin(LYING_RAD)])
        R_case_shaft = _frame(shaft, [1.0, 0.0, 0.0])
        R_tool_shaft = _frame(T_tool_ladle[:3, 2], [0.0, 1.0, 0.0])
        R_case_tool = R_case_shaft @ R_tool_shaft.T
        height = (
            CASE_FLOOR_M
            + HANDLE_HALF_WIDTH_M * math.cos(LYING_RAD)
            + HANDLE_HALF_LENGTH_M * math.sin(LYING_RAD)
        )
        p_case_handle = np.array([0.0, way * self._handle_y_m, height + above_m])
        T_case_tool = make_pose(R_case_tool, p_case_handle - R_case_tool @ T_tool_ladle[:3, 3])
        return T_world_case @ T_case_tool

    def _holds_ladle(self, view: DemonstratorView) -> bool:
        """Whether the handle is still between the pads: near them, and they are apart."""
        T_tool_ladle = invert(view.T_world_tool) @ view.objects["ladle"]
        near = norm(T_tool_ladle[:3, 3] - [self._depth_m, 0.0, 0.0]) < 0.06
        return near and view.opening_m > HANDLE_HALF_WIDTH_M


def _level_hand(R_world_ladle: Array) -> Array:
    """R_world_tool of a level hand across the ladle, pointing away from the robot.

    Its y axis, on which the pads close, is the flattest of the normals of the handle's sides.
    """
    x_axis, y_axis = R_world_ladle[:, 0], R_world_ladle[:, 1]
    left = x_axis if abs(x_axis[2]) <= abs(y_axis[2]) else y_axis
    left = left * math.copysign(1.0, float(left[1]))
    forward = np.cross(left, [0.0, 0.0, 1.0])
    forward = forward / norm(forward)
    return np.column_stack([forward, left, np.cross(forward, left)])


def _frame(first: Array, second: list[float]) -> Array:
    """Rotation whose first axis is `first`, and whose second is as near to `second` as can be."""
    third = np.cross(first, second)
    third = third / norm(third)
    return np.column_stack([first, np.cross(third, first), third])


def _drawn_back(T_world_tool: Array, way_m: float) -> Array:
    """The pose moved back along the fingers."""
    return T_world_tool @ make_pose(np.eye(3), [-way_m, 0.0, 0.0])
