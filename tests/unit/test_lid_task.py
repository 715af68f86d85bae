"""The success test of the lid task, with poses placed by hand on both sides of every threshold."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from common.se3 import exp3, make_pose
from common.tasks import load_task
from common.tasks.lid import SEATED_HEIGHT_M, LidTask
from common.tasks.task import ObjectState, SuccessMonitor, TaskState

POT = np.array([0.68, 0.01, 0.72])


def at_rest(p: np.ndarray, w: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> ObjectState:
    return ObjectState(make_pose(exp3(w), p), np.zeros(3), np.zeros(3))


def seated(
    dx: float = 0.0, dz: float = 0.0, tilt: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> TaskState:
    pot = at_rest(POT)
    lid = at_rest(POT + [dx, 0.0, SEATED_HEIGHT_M + dz], tilt)
    stove = at_rest(POT - [0.0, 0.0, 0.02])
    objects = {"pot": pot, "lid": lid, "stove": stove}
    return TaskState(objects=objects, initial=objects, grasp=False, touching_robot=frozenset())


def moved(state: TaskState, **objects: ObjectState) -> TaskState:
    return replace(state, objects={**state.objects, **objects})


def spinning(state: ObjectState, v: float, w: float) -> ObjectState:
    return replace(state, velocity_m_s=np.array([v, 0, 0]), velocity_rad_s=np.array([0, w, 0]))


task = LidTask()
inside = [
    seated(),
    seated(dx=0.0119),
    seated(dz=0.0049),
    seated(dz=-0.0049),
    seated(tilt=(math.radians(1.9), 0, 0)),
    seated(tilt=(0, 0, 2.0)),
    moved(seated(), lid=spinning(seated().objects["lid"], 0.049, 0.49)),
]
outside = {
    "lid within 12 mm of the pot axis": seated(dx=0.0121),
    "lid 85..95 mm above the pot origin": seated(dz=0.0051),
    "lid and pot axes within 2 deg": seated(tilt=(math.radians(2.1), 0, 0)),
    "grasp is open": replace(seated(), grasp=True),
    "robot does not touch the lid": replace(seated(), touching_robot=frozenset({"lid"})),
    "lid is at rest": moved(seated(), lid=spinning(seated().objects["lid"], 0.051, 0.0)),
}


@pytest.mark.parametrize("state", inside)
def test_correct_placements_pass(state: TaskState):
    assert task.judge(state).failed == ()


@pytest.mark.parametrize("condition", outside)
def test_each_condition_fails_alone(condition: str):
    assert task.judge(outside[condition]).failed == (condition,)


def test_what_the_hand_does_is_no_matter_of_placement():
    for condition, state in outside.items():
        judgement = task.judge(state)
        of_hand = condition in ("grasp is open", "robot does not touch the lid")
        assert judgement.placed == of_hand
        assert not judgement.holds


def test_turning_counts_as_moving():
    state = moved(seated(), lid=spinning(seated().objects["lid"], 0.0, 0.51))
    assert task.judge(state).failed == ("lid is at rest",)


@pytest.mark.parametrize(
    ("shift", "failed"),
    [
        ([0.049, 0.0, 0.0], ()),
        ([0.051, 0.0, 0.0], ("pot moved at most 50 mm sideways",)),
        ([0.0, 0.0, 0.009], ()),
        ([0.0, 0.0, -0.011], ("pot moved at most 10 mm in height",)),
    ],
)
def test_the_pot_must_stay(shift: list[float], failed: tuple[str, ...]):
    start = seated()
    pot = at_rest(POT + shift)
    lid = at_rest(POT + shift + [0.0, 0.0, SEATED_HEIGHT_M])
    assert task.judge(moved(start, pot=pot, lid=lid)).failed == failed


CHEATS = {
    "held above the pot": seated(dz=0.05),
    "resting on the rim": seated(dz=0.010),
    "upside down on the pot": seated(tilt=(math.pi, 0.0, 0.0)),
    "dropped beside it": moved(seated(), lid=at_rest(np.array([0.62, -0.25, 0.70]))),
    "standing on edge": seated(tilt=(math.pi / 2, 0.0, 0.0)),
    "inside an overturned pot": moved(
        seated(),
        pot=at_rest(POT, (0.5, 0.0, 0.0)),
        lid=at_rest(POT + [0.0, -0.043, 0.079], (0.5, 0.0, 0.0)),
    ),
}


@pytest.mark.parametrize("cheat", CHEATS)
def test_cheats_fail(cheat: str):
    assert not task.judge(CHEATS[cheat]).holds


def test_a_fallen_lid_ends_the_episode():
    state = moved(seated(), lid=at_rest(np.array([0.3, 0.0, 0.59])))
    assert task.judge(state).lost == "the lid fell off the table"
    assert task.judge(seated()).lost is None


def test_success_must_hold_for_half_a_second():
    monitor = SuccessMonitor()
    good, bad = task.judge(seated()), task.judge(seated(dx=0.05))
    assert not any(monitor.update(good) for _ in range(49))
    assert not monitor.update(bad)
    assert not any(monitor.update(good) for _ in range(49))
    assert monitor.update(good)


def test_spawns_stay_in_their_ranges_and_follow_the_seed():
    for seed in range(200):
        first = load_task("lid").spawn(np.random.default_rng([seed, 0]))
        again = load_task("lid").spawn(np.random.default_rng([seed, 0]))
        poses = {item.name: item.T_world_object for item in first}
        for item in again:
            np.testing.assert_array_equal(poses[item.name], item.T_world_object)
        stove, lid = poses["stove"][:3, 3], poses["lid"][:3, 3]
        assert 0.67 <= stove[0] <= 0.69
        assert abs(stove[1]) <= 0.05
        assert -0.07 <= lid[0] - stove[0] <= -0.04
        assert -0.28 <= lid[1] - stove[1] <= -0.22
        assert lid[2] == pytest.approx(0.7005)
        assert poses["pot"][2, 3] == pytest.approx(0.721, abs=1e-3)
