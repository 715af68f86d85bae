"""Shelving the cup: take it by its handle from the table and stand it in the cabinet.

Geometry, spawn ranges and thresholds follow the simulation of the paper, except that the cabinet
stands 0.12 m nearer to the world's origin, as every robot reaches it then.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from common.se3 import Array, invert
from common.tasks.cup_scene import (
    CABINET_BASE_M,
    CUP_HALF_HEIGHT_M,
    CUP_RADIUS_M,
    HANDLE_OUTER_M,
    HANDLE_RING_M,
    HANDLE_WIDTH_M,
    TABLE,
    TABLE_TOP_M,
    build_cup_scene,
)
from common.tasks.cup_script import PLACE_Y_M, STANDING_Z_M, CupScript
from common.tasks.poses import norm, tilt_of, upright
from common.tasks.task import (
    Judgement,
    Obstacle,
    SceneCamera,
    SpawnedObject,
    TaskState,
)

Layout: TypeAlias = Literal["reachable", "original"]
"""Where the cabinet stands: 0.12 m nearer to the world's origin, or as the paper has it."""

_SPAWN_GAP_M = 0.0005
_PAD_STATIONS_M = tuple(0.0525 * (i / 4 - 1.0) for i in range(9))
"""Points along a pad of 105 mm, from its root to its tip."""
_CABINET_SHIFT_M: dict[Layout, tuple[float, float]] = {
    "reachable": (-0.0945, 0.074),
    "original": (0.0, 0.0),
}
_VIEWPOINT = SceneCamera(position_m=(0.06, 1.50, 1.60), target_m=(0.30, -0.10, 0.80), fovy_deg=46.0)


@dataclass(frozen=True)
class CupTask:
    """The task that reaches furthest: a thin handle to hold, and a cabinet to get into and out of.

    Args:
        layout: Where the cabinet stands.
    """

    name: str = "cup"
    title: str = "Shelving the cup (reachable layout)"
    time_limit_s: float = 40.0
    moved_object: str = "cup"
    objects: tuple[str, ...] = ("cabinet", "cup")
    scene_camera: SceneCamera = _VIEWPOINT
    obstacles: tuple[Obstacle, ...] = (TABLE.obstacle,)
    layout: Layout = "reachable"

    def scene_xml(self) -> str:
        """Floor, table, cabinet and cup."""
        return build_cup_scene()

    def spawn(self, random: np.random.Generator) -> list[SpawnedObject]:
        """Draw the cabinet on the right of the table, and the cup in front of it.

        Cabinet x U(.768, .843), y U(-.726, -.526), turned U(54, 72) deg; in the original layout
        x U(.8625, .9375), y U(-.8, -.6). Cup x U(.5425, .5825), y U(.08, .12), turned
        U(117, 153) deg, which points its handle at the robot.
        """
        x, y = random.uniform(0.8625, 0.9375), random.uniform(-0.8, -0.6)
        cabinet_yaw = math.radians(random.uniform(54.0, 72.0))
        cup_x, cup_y = random.uniform(0.5425, 0.5825), random.uniform(0.08, 0.12)
        cup_yaw = math.radians(random.uniform(117.0, 153.0))
        dx, dy = _CABINET_SHIFT_M[self.layout]
        z = TABLE_TOP_M + _SPAWN_GAP_M
        return [
            SpawnedObject("cabinet", upright(x + dx, y + dy, z - CABINET_BASE_M, cabinet_yaw)),
            SpawnedObject("cup", upright(cup_x, cup_y, z + CUP_HALF_HEIGHT_M, cup_yaw)),
        ]

    def judge(self, state: TaskState) -> Judgement:
        """Standing on the cabinet's floor, released, the hand away, nothing knocked over.

        In the cabinet's frame: cup centre within 150 mm of the middle plane, y -50..90 mm, z
        -110..-90 mm (standing: -100 mm); cup tilted at most 10 deg, cabinet at most 5 deg; finger
        pads at least 50 mm from the cup; grasp open, nothing of the robot touching the cup, cup
        slower than 0.05 m/s and 0.5 rad/s.
        """
        cup, cabinet = state.objects["cup"], state.objects["cabinet"]
        T_cabinet_cup = invert(cabinet.T_world_object) @ cup.T_world_object
        x, y, z = T_cabinet_cup[:3, 3].tolist()
        T_cup_world = invert(cup.T_world_object)
        clearance = min((_clearance(T_cup_world @ T) for T in state.T_world_pads), default=math.inf)
        hand = {
            "grasp is open": not state.grasp,
            "robot does not touch the cup": "cup" not in state.touching_robot,
            "finger pads at least 50 mm from the cup": clearance >= 0.05,
        }
        objects = {
            "cup is at rest": norm(cup.velocity_m_s) < 0.05 and norm(cup.velocity_rad_s) < 0.5,
            "cup within 150 mm of the cabinet's middle": abs(x) <= 0.15,
            "cup 50 mm behind to 90 mm before the cabinet's middle": -0.05 <= y <= 0.09,
            "cup 90..110 mm below the cabinet's centre": -0.11 <= z <= -0.09,
            "cup tilted at most 10 deg": tilt_of(cup.T_world_object) <= math.radians(10.0),
            "cabinet tilted at most 5 deg": tilt_of(cabinet.T_world_object) <= math.radians(5.0),
        }
        return Judgement.of(
            hand=hand,
            objects=objects,
            goal_distance_m=norm(T_cabinet_cup[:3, 3] - [0.0, PLACE_Y_M, STANDING_Z_M]),
            lost=(
                "the cup fell off the table"
                if cup.T_world_object[2, 3] < TABLE_TOP_M - 0.10
                else None
            ),
        )

    def script(self, random: np.random.Generator) -> CupScript:
        """A demonstrator's plan, with its own pace and grasp."""
        return CupScript(random)


def _clearance(T_cup_pad: Array) -> float:
    """Distance from a pad's middle line to the cup and its handle, both taken as solid [m]."""
    points = T_cup_pad[:3, 3] + np.outer(_PAD_STATIONS_M, T_cup_pad[:3, 0])
    return min(min(_to_cup(*point), _to_handle(*point)) for point in points.tolist())


def _to_cup(x: float, y: float, z: float) -> float:
    outside = max(0.0, math.hypot(x, y) - CUP_RADIUS_M)
    return math.hypot(outside, max(0.0, abs(z) - CUP_HALF_HEIGHT_M))


def _to_handle(x: float, y: float, z: float) -> float:
    return math.hypot(
        max(0.0, abs(x) - 0.5 * HANDLE_WIDTH_M),
        max(0.0, y - HANDLE_RING_M - HANDLE_OUTER_M, CUP_RADIUS_M - y),
        max(0.0, abs(z) - HANDLE_OUTER_M),
    )
