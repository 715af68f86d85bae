"""Putting the ladle away: take it from where it leans on the pot and lay it in its case.

Geometry, spawn ranges and thresholds follow the simulation of the paper; the ladle is also turned
about the pot, which the paper's simulation never did. `ladle_scene` tells where it leans.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from common.se3 import invert, make_pose
from common.tasks.ladle_scene import (
    CASE_BASE_M,
    TABLE,
    TABLE_TOP_M,
    build_ladle_scene,
    centres_outside_m,
    lean_on_pot,
)
from common.tasks.ladle_script import LadleScript
from common.tasks.poses import norm, tilt_of, upright
from common.tasks.stove import STOVE_TOP_M
from common.tasks.task import (
    Judgement,
    Obstacle,
    SceneCamera,
    SpawnedObject,
    TaskState,
)

POT_YAW_RAD = math.radians(22.0)
"""The ladle leans on the pot's wall at -x: this side of the stove has room for it to be turned."""

_SPAWN_GAP_M = 0.0005
_VIEWPOINT = SceneCamera(
    position_m=(1.35, -1.25, 1.45), target_m=(0.40, -0.03, 0.79), fovy_deg=40.0
)


@dataclass(frozen=True)
class LadleTask:
    """The task that needs the longest way and a grasp that does not let a long thing turn."""

    name: str = "ladle"
    title: str = "Putting the ladle away"
    time_limit_s: float = 40.0
    moved_object: str = "ladle"
    objects: tuple[str, ...] = ("stove", "pot", "ladle", "case")
    scene_camera: SceneCamera = _VIEWPOINT
    obstacles: tuple[Obstacle, ...] = (TABLE.obstacle,)

    def scene_xml(self) -> str:
        """Floor, table, stove, pot, ladle and utensil case."""
        return build_ladle_scene()

    def spawn(self, random: np.random.Generator) -> list[SpawnedObject]:
        """Draw the stove with the pot and the ladle that leans on it, and the case on the right.

        Stove x .60, y U(.18, .42); the ladle turned U(-15, 15) deg about the pot's vertical axis;
        case x .5625, y U(-.42, -.38), turned U(67.5, 112.5) deg.
        """
        stove_y = random.uniform(0.18, 0.42)
        turn = math.radians(random.uniform(-15.0, 15.0))
        case_y = random.uniform(-0.42, -0.38)
        case_yaw = math.radians(random.uniform(67.5, 112.5))
        z = TABLE_TOP_M + _SPAWN_GAP_M
        T_world_pot = upright(0.60, stove_y, z + STOVE_TOP_M + _SPAWN_GAP_M, POT_YAW_RAD)
        T_gap = make_pose(np.eye(3), [0.0, 0.0, _SPAWN_GAP_M])
        return [
            SpawnedObject("stove", upright(0.60, stove_y, z, 0.0)),
            SpawnedObject("pot", T_world_pot),
            SpawnedObject("ladle", T_world_pot @ T_gap @ lean_on_pot(turn)),
            SpawnedObject("case", upright(0.5625, case_y, z - CASE_BASE_M, case_yaw)),
        ]

    def judge(self, state: TaskState) -> Judgement:
        """Handle and scoop in the case, released, at rest, and the case not pushed away.

        In the case's frame the middles of handle and scoop have |x| <= 80 mm, |y| <= 130 mm and
        z <= 85 mm; case moved at most 50 mm and tilted at most 5 deg; grasp open, nothing of the
        robot touching the ladle, ladle slower than 0.05 m/s and 0.5 rad/s.
        """
        ladle, case = state.objects["ladle"], state.objects["case"]
        outside = centres_outside_m(invert(case.T_world_object) @ ladle.T_world_object)
        case_shift = case.T_world_object[:3, 3] - state.initial["case"].T_world_object[:3, 3]
        hand = {
            "grasp is open": not state.grasp,
            "robot does not touch the ladle": "ladle" not in state.touching_robot,
        }
        objects = {
            "ladle is at rest": norm(ladle.velocity_m_s) < 0.05
            and norm(ladle.velocity_rad_s) < 0.5,
            "handle in the case": outside["handle"] == 0.0,
            "scoop in the case": outside["scoop"] == 0.0,
            "case moved at most 50 mm": norm(case_shift) <= 0.050,
            "case tilted at most 5 deg": tilt_of(case.T_world_object) <= math.radians(5.0),
        }
        return Judgement.of(
            hand=hand,
            objects=objects,
            goal_distance_m=max(outside.values()),
            lost=(
                "the ladle fell off the table"
                if ladle.T_world_object[2, 3] < TABLE_TOP_M - 0.10
                else None
            ),
        )

    def script(self, random: np.random.Generator) -> LadleScript:
        """A demonstrator's plan, with its own pace and grasp."""
        return LadleScript(random)
