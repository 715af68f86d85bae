"""How far an episode came, with states and judgements made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from common.se3 import make_pose
from common.tasks.task import Judgement, ObjectState, TaskState
from services.sim.stages import StageMonitor

START_M = 0.7


def at(height_m: float) -> ObjectState:
    return ObjectState(make_pose(np.eye(3), [0.5, 0.0, height_m]), np.zeros(3), np.zeros(3))


def state(*, grasp: bool = True, touching: str = "lid", rise_m: float = 0.0) -> TaskState:
    return TaskState(
        objects={"lid": at(START_M + rise_m), "pot": at(START_M + 1.0)},
        initial={"lid": at(START_M), "pot": at(START_M)},
        grasp=grasp,
        touching_robot=frozenset({touching}),
    )


def judgement(*, hand: bool = False, objects: bool = False) -> Judgement:
    return Judgement.of(hand={"open": hand}, objects={"there": objects}, goal_distance_m=0.1)


def reached_by(*looks: tuple[int, TaskState], said: Judgement | None = None) -> list[str]:
    monitor = StageMonitor("lid")
    for step, seen in looks:
        monitor.update(seen, said or judgement(), step=step)
    return monitor.reached.names


def test_nothing_is_reached_at_first():
    assert reached_by() == []
    assert reached_by((1, state(grasp=False)), (30, state(grasp=False))) == []


@pytest.mark.parametrize(("last", "reached"), [(139, []), (140, ["grasped"])])
def test_a_grasp_is_a_touch_of_a_fifth_of_a_second(last: int, reached: list[str]):
    assert reached_by((120, state()), (130, state()), (last, state())) == reached


@pytest.mark.parametrize("between", [state(grasp=False), state(touching="pot")])
def test_a_touch_that_ends_begins_anew(between: TaskState):
    looks = [(0, state()), (10, between), (20, state()), (30, state())]
    assert reached_by(*looks) == []
    assert reached_by(*looks, (40, state())) == ["grasped"]


@pytest.mark.parametrize(("rise_m", "reached"), [(0.019, []), (0.021, ["lifted"])])
def test_lifted_takes_twenty_millimetres_of_the_moved_object(rise_m: float, reached: list[str]):
    looks = [(0, state()), (10, state(rise_m=rise_m)), (20, state(rise_m=rise_m))]
    assert reached_by(*looks) == ["grasped", *reached]


def test_what_rises_without_being_held_is_not_lifted():
    high = state(rise_m=0.1)
    assert reached_by((0, high), (10, high)) == []
    after = [(20, state()), (30, state()), (40, state(rise_m=0.1, grasp=False))]
    assert reached_by((10, state()), *after) == ["grasped"]


@pytest.mark.parametrize(
    ("hand", "objects", "reached"),
    [
        (False, False, []),
        (True, False, []),
        (False, True, ["placed"]),
        (True, True, ["placed", "released"]),
    ],
)
def test_placed_is_about_objects_and_released_about_everything(
    hand: bool, objects: bool, reached: list[str]
):
    said = judgement(hand=hand, objects=objects)
    assert reached_by((0, state(grasp=False)), said=said) == reached


def test_what_was_reached_stays_reached():
    monitor = StageMonitor("lid")
    for step in (0, 20):
        monitor.update(state(rise_m=0.05), judgement(), step=step)
    monitor.update(state(grasp=False), judgement(hand=True, objects=True), step=30)
    assert monitor.reached.names == ["grasped", "lifted", "placed", "released"]
    monitor.update(state(grasp=False), judgement(), step=40)
    assert monitor.reached.names == ["grasped", "lifted", "placed", "released"]
