"""Closing the lid: take the lid from the table and seat it on the pot.

Geometry, spawn ranges and thresholds follow the simulation of the paper; the lid and the pot are
also turned a little, which the paper's simulation never did.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from common.calibration.four_bar import driver_rad, pad_centre_x_m
from common.se3 import Array, exp3, invert, make_pose
from common.tasks.poses import norm, shifted, tilt_of, upright, yaw_of
from common.tasks.staged_script import StagedScript
from common.tasks.stove import STOVE_TOP_M, build_pot, build_stove
from common.tasks.table import Table
from common.tasks.task import (
    DemonstratorView,
    Judgement,
    Obstacle,
    SceneCamera,
    SpawnedObject,
    TaskState,
    Waypoint,
)

TABLE_TOP_M = 0.70
SEATED_HEIGHT_M = 0.090
"""Lid origin above pot origin when the lid is seated; on the rim it is 0.100."""
BAR_HEIGHT_M = 0.070
BAR_WIDTH_M = 0.026

_SPAWN_GAP_M = 0.0005
_TABLE = Table(top_m=TABLE_TOP_M, centre_x_m=1.0, half_depth_m=0.5)

_SCENE = f"""
<mujoco model="lid">
  <compiler angle="radian"/>
  <default>
    <geom friction="0.7 0.005 0.0001"/>
    <default class="pot"><geom rgba="0.62 0.64 0.68 1"/></default>
    <default class="lid"><geom rgba="0.80 0.30 0.22 1"/></default>
    <default class="dark"><geom rgba="0.13 0.13 0.15 1"/></default>
  </default>
  <worldbody>
    <geom name="floor" type="plane" size="4 4 0.1" rgba="0.55 0.56 0.58 1"/>
    {_TABLE.build()}
    {build_stove()}
    {build_pot()}
    <body name="lid">
      <freejoint/>
      <geom name="lid_plug" class="lid" type="cylinder" size="0.08 0.005" pos="0 0 0.005"
            mass="0.05"/>
      <geom name="lid_disc" class="lid" type="cylinder" size="0.11 0.005" pos="0 0 0.015"
            mass="0.08"/>
      <geom name="lid_post_0" class="dark" type="box" size="0.005 0.005 0.020"
            pos="0.035 0 0.040" mass="0.004"/>
      <geom name="lid_post_1" class="dark" type="box" size="0.005 0.005 0.020"
            pos="-0.035 0 0.040" mass="0.004"/>
      <geom name="lid_bar" class="dark" type="box" size="0.04 {BAR_WIDTH_M / 2} 0.013"
            pos="0 0 {BAR_HEIGHT_M}" mass="0.024"/>
    </body>
  </worldbody>
</mujoco>
"""

_VIEWPOINT = SceneCamera(
    position_m=(1.40, -1.30, 1.50), target_m=(0.40, -0.06, 0.88), fovy_deg=42.0
)


@dataclass(frozen=True)
class LidTask:
    """The task of the paper's Figure 1 that needs the most precise placement."""

    name: str = "lid"
    title: str = "Closing the lid"
    time_limit_s: float = 40.0
    moved_object: str = "lid"
    objects: tuple[str, ...] = ("stove", "pot", "lid")
    scene_camera: SceneCamera = _VIEWPOINT
    obstacles: tuple[Obstacle, ...] = (_TABLE.obstacle,)

    def scene_xml(self) -> str:
        """Floor, table, stove, pot and lid."""
        return _SCENE

    def spawn(self, random: np.random.Generator) -> list[SpawnedObject]:
        """Draw the stove with the pot on it, and the lid on the table beside it.

        Stove x U(.67, .69), y U(-.05, .05); lid from the stove dx U(-.07, -.04), dy U(-.28, -.22);
        lid turned U(-20, 20) deg, pot U(-6, 6) deg about the vertical.
        """
        stove_x, stove_y = random.uniform(0.67, 0.69), random.uniform(-0.05, 0.05)
        lid_dx, lid_dy = random.uniform(-0.07, -0.04), random.uniform(-0.28, -0.22)
        lid_yaw = math.radians(random.uniform(-20.0, 20.0))
        pot_yaw = math.radians(random.uniform(-6.0, 6.0))
        z = TABLE_TOP_M + _SPAWN_GAP_M
        return [
            SpawnedObject("stove", upright(stove_x, stove_y, z, 0.0)),
            SpawnedObject(
                "pot", upright(stove_x, stove_y, z + STOVE_TOP_M + _SPAWN_GAP_M, pot_yaw)
            ),
            SpawnedObject("lid", upright(stove_x + lid_dx, stove_y + lid_dy, z, lid_yaw)),
        ]

    def judge(self, state: TaskState) -> Judgement:
        """Seated, released, at rest, and the pot not pushed away.

        In the pot frame: lid origin within 12 mm of the axis and 85..95 mm high, axes within
        2 deg; pot tilted at most 5 deg and moved at most 50 mm sideways and 10 mm in height;
        grasp open, nothing of the robot touching the lid, lid slower than 0.05 m/s and 0.5 rad/s.
        """
        lid, pot = state.objects["lid"], state.objects["pot"]
        pot_start = state.initial["pot"].T_world_object
        T_pot_lid = invert(pot.T_world_object) @ lid.T_world_object
        x, y, z = T_pot_lid[:3, 3].tolist()
        pot_shift = (pot.T_world_object[:3, 3] - pot_start[:3, 3]).tolist()
        hand = {
            "grasp is open": not state.grasp,
            "robot does not touch the lid": "lid" not in state.touching_robot,
        }
        objects = {
            "lid is at rest": norm(lid.velocity_m_s) < 0.05 and norm(lid.velocity_rad_s) < 0.5,
            "lid within 12 mm of the pot axis": math.hypot(x, y) <= 0.012,
            "lid 85..95 mm above the pot origin": 0.085 <= z <= 0.095,
            "lid and pot axes within 2 deg": tilt_of(T_pot_lid) <= math.radians(2.0),
            "pot tilted at most 5 deg": tilt_of(pot.T_world_object) <= math.radians(5.0),
            "pot moved at most 50 mm sideways": math.hypot(*pot_shift[:2]) <= 0.050,
            "pot moved at most 10 mm in height": abs(pot_shift[2]) <= 0.010,
        }
        return Judgement.of(
            hand=hand,
            objects=objects,
            goal_distance_m=math.hypot(x, y, z - SEATED_HEIGHT_M),
            lost=(
                "the lid fell off the table"
                if lid.T_world_object[2, 3] < TABLE_TOP_M - 0.10
                else None
            ),
        )

    def script(self, random: np.random.Generator) -> LidScript:
        """A demonstrator's plan, with its own pace and grasp."""
        return LidScript(random)


class LidScript(StagedScript):
    """Grasp the bar, escape sideways, lift, carry, measure, correct, lower, release, retreat.

    Lifting straight up catches the lid under the pot's handle, so the hand first moves away from
    the pot. Everything after the grasp is planned for the lid as it really lies in the hand.
    """

    def __init__(self, random: np.random.Generator) -> None:
        super().__init__()
        self._pitch_rad = math.radians(random.uniform(37.0, 43.0))
        self._along_bar_m = random.uniform(-0.008, 0.008)
        self._depth_m = random.uniform(-0.006, 0.002)
        self._hover_m = random.uniform(0.05, 0.08)
        self._lift_m = random.uniform(0.14, 0.18)
        self._look_s = random.uniform(0.0, 0.3)
        self._grasp_attempts = 0

    def _approach(self, view: DemonstratorView) -> list[Waypoint]:
        self._grasp_attempts += 1
        self._stage = self._carry
        T_grasp = self._grasp_pose(view.objects["lid"])
        T_hover = shifted(T_grasp, up=self._hover_m, back=0.03)
        return [
            Waypoint("hover", T_hover, grasp=False, look_s=self._look_s),
            Waypoint("descend", T_grasp, grasp=False, speed_m_s=0.12, wait_s=0.2),
            Waypoint("close", None, grasp=True, wait_s=0.8),
        ]

    def _carry(self, view: DemonstratorView) -> list[Waypoint]:
        T_lid = view.objects["lid"]
        T_escape = view.T_world_tool.copy()
        away = -1.0 if T_lid[1, 3] < view.objects["pot"][1, 3] else 1.0
        T_escape[:3, 3] += (-0.02, 0.08 * away, 0.04)
        T_lift = T_escape.copy()
        T_lift[2, 3] += self._lift_m - 0.04
        self._stage = self._align
        return [
            Waypoint("escape", T_escape, grasp=True, speed_m_s=0.2),
            Waypoint("lift", T_lift, grasp=True, look_s=0.2),
        ]

    def _align(self, view: DemonstratorView) -> list[Waypoint]:
        if not self._holds_lid(view):
            return self._recover(view)
        self._stage = self._lower
        T_above = self._tool_for_lid(view, above_m=0.06)
        return [Waypoint("carry", T_above, grasp=True, look_s=0.3)]

    def _lower(self, view: DemonstratorView) -> list[Waypoint]:
        if not self._holds_lid(view):
            return self._recover(view)
        self._stage = self._release
        return [
            Waypoint(
                "correct",
                self._tool_for_lid(view, above_m=0.03),
                grasp=True,
                wait_s=0.1,
                look_s=0.3,
            ),
        ]

    def _release(self, view: DemonstratorView) -> list[Waypoint]:
        self._stage = self._retreat
        T_seat = self._tool_for_lid(view, above_m=0.001)
        return [
            Waypoint("lower", T_seat, grasp=True, speed_m_s=0.06, wait_s=0.4),
            Waypoint("open", None, grasp=False, wait_s=0.6),
        ]

    def _retreat(self, view: DemonstratorView) -> list[Waypoint]:
        self._stage = self._inspect
        T_back = shifted(view.T_world_tool, up=0.03, back=0.12)
        return [Waypoint("retreat", T_back, grasp=False, speed_m_s=0.2, wait_s=0.8)]

    def _inspect(self, view: DemonstratorView) -> list[Waypoint]:
        """Try again when the lid is not seated, as a person would."""
        T_pot_lid = invert(view.objects["pot"]) @ view.objects["lid"]
        x, y, z = T_pot_lid[:3, 3].tolist()
        seated = math.hypot(x, y) <= 0.012 and abs(z - SEATED_HEIGHT_M) <= 0.005
        if seated or self._grasp_attempts >= 3:
            self._done = True
            return []
        return self._recover(view)

    def _recover(self, view: DemonstratorView) -> list[Waypoint]:
        """Open, go up and start over; give up after three grasps."""
        if self._grasp_attempts >= 3:
            self._done = True
            return []
        self._stage = self._approach
        return [
            Waypoint("let go", None, grasp=False, wait_s=0.8),
            Waypoint("back up", shifted(view.T_world_tool, up=0.06), grasp=False),
        ]

    def _grasp_pose(self, T_world_lid: Array) -> Array:
        """Tool pose with the bar between the pads, pitched down, fingers along the bar."""
        yaw = yaw_of(T_world_lid)
        # The bar is the same from both ends: take the end that needs less turning.
        if abs(yaw) > math.pi / 2:
            yaw -= math.copysign(math.pi, yaw)
        R_world_tool = exp3([0.0, 0.0, yaw]) @ exp3([0.0, self._pitch_rad, 0.0])
        p_world_bar = (T_world_lid @ [0.0, 0.0, BAR_HEIGHT_M - 0.004 + self._depth_m, 1.0])[:3]
        reach = pad_centre_x_m(driver_rad(BAR_WIDTH_M))
        heading = np.array([math.cos(yaw), math.sin(yaw), 0.0])
        p = p_world_bar + self._along_bar_m * heading - R_world_tool @ [reach, 0.0, 0.0]
        return make_pose(R_world_tool, p)

    def _tool_for_lid(self, view: DemonstratorView, *, above_m: float) -> Array:
        """Tool pose that puts the lid, as it lies in the hand, level above its seat."""
        T_lid = view.objects["lid"]
        T_tool_lid = invert(view.T_world_tool) @ T_lid
        pot = view.objects["pot"]
        p_seat = pot[:3, 3] + pot[:3, 2] * (SEATED_HEIGHT_M + above_m)
        yaw = yaw_of(T_lid)
        return make_pose(exp3([0.0, 0.0, yaw]), p_seat) @ invert(T_tool_lid)

    def _holds_lid(self, view: DemonstratorView) -> bool:
        """Whether the bar is still between the pads: near them, and they are apart."""
        T_tool_lid = invert(view.T_world_tool) @ view.objects["lid"]
        p_tool_bar = (T_tool_lid @ [0.0, 0.0, BAR_HEIGHT_M, 1.0])[:3]
        reach = pad_centre_x_m(driver_rad(BAR_WIDTH_M))
        near = norm(p_tool_bar - np.array([reach, 0.0, 0.0])) < 0.05
        return near and view.opening_m > 0.5 * BAR_WIDTH_M
