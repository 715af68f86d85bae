"""The ladle's success test on both sides of every limit, and what must not pass it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

import numpy as np
import pytest

from common.se3 import exp3, invert, make_pose
from common.tasks.ladle import LadleTask
from common.tasks.ladle_scene import (
    CASE_FLOOR_M,
    HANDLE_HALF_LENGTH_M,
    HANDLE_HALF_WIDTH_M,
    LYING_RAD,
    SCOOP_CENTRE_M,
)
from common.tasks.task import ObjectState, TaskState
from services.sim.world import World
from tests.ladle_world import make_ladle_world, pose, put

Triple: TypeAlias = tuple[float, float, float]
Placing: TypeAlias = Callable[[Triple, Triple], TaskState]

task = LadleTask()
CASE = make_pose(exp3([0.0, 0.0, 1.4]), [0.5625, -0.40, 0.635])

# As it lies in the case: shaft along the case and rising, scoop hanging down.
SHAFT = np.array([0.0, -math.cos(LYING_RAD), math.sin(LYING_RAD)])
LYING = np.column_stack([[-1.0, 0.0, 0.0], np.cross(SHAFT, [-1.0, 0.0, 0.0]), SHAFT])
HEIGHT = (
    CASE_FLOOR_M
    + HANDLE_HALF_WIDTH_M * math.cos(LYING_RAD)
    + HANDLE_HALF_LENGTH_M * math.sin(LYING_RAD)
)


def at_rest(T: np.ndarray) -> ObjectState:
    return ObjectState(T, np.zeros(3), np.zeros(3))


def put_away(T_case_ladle: np.ndarray | None = None) -> TaskState:
    T = make_pose(LYING, [0.0, 0.06, HEIGHT]) if T_case_ladle is None else T_case_ladle
    objects = {"ladle": at_rest(CASE @ T), "case": at_rest(CASE)}
    return TaskState(objects=objects, initial=objects, grasp=False, touching_robot=frozenset())


def moving(v: float, w: float) -> TaskState:
    ladle = put_away().objects["ladle"]
    fast = replace(ladle, velocity_m_s=np.array([v, 0, 0]), velocity_rad_s=np.array([0, w, 0]))
    return replace(put_away(), objects={**put_away().objects, "ladle": fast})


def carried_off(shift: Triple, tilt_deg: float = 0.0) -> TaskState:
    """The case moved with the ladle in it."""
    T_shift = make_pose(np.eye(3), shift)
    T_tilt = make_pose(exp3([math.radians(tilt_deg), 0.0, 0.0]), [0.0, 0.0, 0.0])
    objects = {
        name: at_rest(T_shift @ CASE @ T_tilt @ invert(CASE) @ state.T_world_object)
        for name, state in put_away().objects.items()
    }
    return replace(put_away(), objects=objects)


def turn_to(local: Triple, way: Triple) -> np.ndarray:
    """A rotation that takes a direction of the ladle to a direction of the case."""
    a, b = np.array(local) / np.linalg.norm(local), np.array(way) / np.linalg.norm(way)
    axis = np.cross(a, b)
    return exp3(axis / np.linalg.norm(axis) * math.acos(float(a @ b)))


def handle_at(point: Triple, way: Triple) -> TaskState:
    """Middle of the handle at a point of the case, the scoop lies that way from it."""
    return put_away(make_pose(turn_to(SCOOP_CENTRE_M, way), point))


def scoop_at(point: Triple, way: Triple) -> TaskState:
    """Middle of the scoop at a point of the case, the handle lies that way from it."""
    x, y, z = way
    R = turn_to(SCOOP_CENTRE_M, (-x, -y, -z))
    return put_away(make_pose(R, np.array(point) - R @ SCOOP_CENTRE_M))


LIMITS = {
    "x": ((0.08, 0.0, 0.05), (-1.0, 0.0, 0.0)),
    "-x": ((-0.08, 0.0, 0.05), (1.0, 0.0, 0.0)),
    "y": ((0.0, 0.13, 0.05), (0.0, -1.0, 0.0)),
    "-y": ((0.0, -0.13, 0.05), (0.0, 1.0, 0.0)),
    "z": ((0.0, 0.06, 0.085), (0.0, -1.0, -0.2)),
}
"""A point on each limit of the cavity, and a way to the inside."""


def beside(point: Triple, name: str, by_m: float) -> Triple:
    """The point moved out of the cavity, along the limit's own axis."""
    outward = np.array([0.0, 0.0, 0.0])
    outward["xyz".index(name[-1])] = -1.0 if name.startswith("-") else 1.0
    x, y, z = (np.array(point) + by_m * outward).tolist()
    return x, y, z


@pytest.mark.parametrize(("part", "place"), [("handle", handle_at), ("scoop", scoop_at)])
@pytest.mark.parametrize("limit", LIMITS)
def test_each_part_must_be_within_every_limit_of_the_case(part: str, place: Placing, limit: str):
    point, way = LIMITS[limit]
    assert task.judge(place(beside(point, limit, -1e-4), way)).failed == ()
    assert task.judge(place(beside(point, limit, 1e-4), way)).failed == (f"{part} in the case",)


INSIDE = {
    "lying": put_away(),
    "nearly at rest": moving(0.049, 0.0),
    "hardly turning": moving(0.0, 0.49),
    "case moved 49 mm": carried_off((0.049, 0.0, 0.0)),
    "case tilted 4.9 deg": carried_off((0.0, 0.0, 0.0), 4.9),
}
OUTSIDE = {
    "grasp is open": [replace(put_away(), grasp=True)],
    "robot does not touch the ladle": [
        replace(put_away(), touching_robot=frozenset({"ladle", "case"}))
    ],
    "ladle is at rest": [moving(0.051, 0.0), moving(0.0, 0.51)],
    "case moved at most 50 mm": [carried_off((0.0, -0.051, 0.0)), carried_off((0.04, 0.0, 0.04))],
    "case tilted at most 5 deg": [carried_off((0.0, 0.0, 0.0), 5.1)],
}


@pytest.mark.parametrize("state", INSIDE.values(), ids=INSIDE)
def test_what_is_within_the_limits_passes(state: TaskState):
    judgement = task.judge(state)
    assert judgement.failed == ()
    assert judgement.goal_distance_m == 0.0
    assert judgement.lost is None


@pytest.mark.parametrize("condition", OUTSIDE)
def test_each_condition_fails_alone(condition: str):
    for state in OUTSIDE[condition]:
        judgement = task.judge(state)
        assert judgement.failed == (condition,)
        of_hand = condition in ("grasp is open", "robot does not touch the ladle")
        assert judgement.placed == of_hand


def test_the_robot_may_touch_the_case():
    assert task.judge(replace(put_away(), touching_robot=frozenset({"case"}))).holds


def test_the_distance_to_the_goal_is_that_of_the_part_further_out():
    state = handle_at((0.0, 0.13 + 0.03, 0.085 + 0.04), (0.0, -1.0, -0.4))
    assert task.judge(state).goal_distance_m == pytest.approx(0.05)


def test_a_fallen_ladle_ends_the_episode():
    fallen = at_rest(make_pose(np.eye(3), [0.3, 0.0, 0.524]))
    state = replace(put_away(), objects={**put_away().objects, "ladle": fallen})
    assert task.judge(state).lost == "the ladle fell off the table"


FLAT = LYING @ exp3([0.0, 0.0, math.pi])
"""Lying with the scoop up."""
AROUND = exp3([0.0, 0.0, math.pi]) @ LYING
LAID_DOWN = {
    "as the demonstrator does": make_pose(LYING, [0.0, 0.06, 0.06]),
    "the other way around": make_pose(AROUND, [0.0, -0.06, 0.06]),
    "askew": make_pose(exp3([0.0, 0.0, 0.3]) @ LYING, [-0.02, 0.06, 0.06]),
    "scoop up": make_pose(FLAT, [0.0, 0.06, 0.06]),
    "dropped from 4 cm": make_pose(LYING, [0.0, 0.06, 0.10]),
}


@pytest.mark.parametrize("way", LAID_DOWN)
def test_a_ladle_laid_into_the_case_passes(way: str):
    world = make_ladle_world()
    put(world, "ladle", pose(world, "case") @ LAID_DOWN[way])
    world.advance(1.0)
    assert task.judge(world.task_state(grasp=False)).failed == ()


def half_out(world: World) -> None:
    put(world, "ladle", pose(world, "case") @ make_pose(LYING, [0.0, 0.0, 0.11]))


def across(world: World) -> None:
    R = exp3([0.0, 0.0, math.pi / 2]) @ LYING
    put(world, "ladle", pose(world, "case") @ make_pose(R, [-0.07, 0.0, 0.10]))


def beside_the_case(world: World) -> None:
    put(world, "ladle", make_pose(exp3([0.0, 0.0, math.pi / 2]) @ LYING, [0.55, 0.0, 0.66]))


def in_the_pot(world: World) -> None:
    R = np.diag([1.0, -1.0, -1.0])
    put(world, "ladle", pose(world, "pot") @ make_pose(R, [0.0, -0.02, 0.175]))


def in_a_case_moved_away(world: World) -> None:
    T_world_case = pose(world, "case")
    T_world_case[0, 3] += 0.08
    put(world, "case", T_world_case)
    put(world, "ladle", T_world_case @ LAID_DOWN["as the demonstrator does"])


def in_a_case_on_edge(world: World) -> None:
    put(world, "ladle", pose(world, "case") @ LAID_DOWN["as the demonstrator does"])
    T_world_case = pose(world, "case")
    T_world_case[:3, :3] = T_world_case[:3, :3] @ exp3([0.0, math.pi / 2, 0.0])
    T_world_case[2, 3] += 0.10
    put(world, "case", T_world_case)


SCOOP_OUT, HANDLE_OUT = "scoop in the case", "handle in the case"
CHEATS: dict[Callable[[World], None], set[str]] = {
    half_out: {SCOOP_OUT},
    across: {SCOOP_OUT, HANDLE_OUT},
    beside_the_case: {SCOOP_OUT, HANDLE_OUT},
    in_the_pot: {SCOOP_OUT, HANDLE_OUT},
    in_a_case_moved_away: {"case moved at most 50 mm"},
    in_a_case_on_edge: {"case tilted at most 5 deg", "case moved at most 50 mm"},
}


@pytest.mark.parametrize("cheat", CHEATS)
def test_cheats_fail(cheat: Callable[[World], None]):
    world = make_ladle_world()
    cheat(world)
    world.advance(1.0)
    assert set(task.judge(world.task_state(grasp=False)).failed) == CHEATS[cheat]


def test_leaning_on_the_pot_is_not_put_away():
    judgement = task.judge(make_ladle_world().task_state(grasp=False))
    assert set(judgement.failed) == {SCOOP_OUT, HANDLE_OUT}
    assert judgement.goal_distance_m > 0.3
