"""The cup task: scene, spawn, success test on both sides of every threshold, cheats."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from common.calibration.four_bar import OPEN_RAD, opening_m, pad_centre_x_m
from common.robots import load_robot
from common.se3 import Array, distance, exp3, invert, make_pose, pose_to_wire
from common.tasks import load_task
from common.tasks.cup import CupTask
from common.tasks.cup_scene import TABLE_TOP_M
from common.tasks.cup_script import STANDING_Z_M
from common.tasks.poses import norm, tilt_of, upright
from common.tasks.task import Judgement, ObjectState, SuccessMonitor, TaskState
from common.tasks.workspaces import REGIONS
from services.sim.world import World

TASK = CupTask()
CABINET = upright(0.80, -0.62, 0.875, math.radians(63.0))
NAMES = {
    "x": "cup within 150 mm of the cabinet's middle",
    "y": "cup 50 mm behind to 90 mm before the cabinet's middle",
    "z": "cup 90..110 mm below the cabinet's centre",
    "cup tilt": "cup tilted at most 10 deg",
    "cabinet tilt": "cabinet tilted at most 5 deg",
    "rest": "cup is at rest",
    "pads": "finger pads at least 50 mm from the cup",
    "grasp": "grasp is open",
    "touch": "robot does not touch the cup",
}


def at_rest(T: Array, v: float = 0.0, w: float = 0.0) -> ObjectState:
    return ObjectState(T, np.array([v, 0.0, 0.0]), np.array([0.0, w, 0.0]))


def shelved(
    p: Sequence[float] = (0.0, 0.05, STANDING_Z_M), *, tilt_deg: float = 0.0, T: Array = CABINET
) -> TaskState:
    """The cup at a place of the cabinet, tilted about its handle."""
    cup = make_pose(T[:3, :3] @ exp3([0.0, math.radians(tilt_deg), 0.0]), (T @ [*p, 1.0])[:3])
    objects = {"cabinet": at_rest(T), "cup": at_rest(cup)}
    return TaskState(objects=objects, initial=objects, grasp=False, touching_robot=frozenset())


def moving(v: float, w: float) -> TaskState:
    state = shelved()
    cup = at_rest(state.objects["cup"].T_world_object, v, w)
    return replace(state, objects={**state.objects, "cup": cup})


def tipped(angle_deg: float) -> TaskState:
    T = make_pose(CABINET[:3, :3] @ exp3([math.radians(angle_deg), 0.0, 0.0]), CABINET[:3, 3])
    return shelved(T=T)


def with_pad(p_cup_tip: Sequence[float], *, heading_rad: float) -> TaskState:
    """A level pad, its tip at a point of the cup's frame."""
    state = shelved()
    R = exp3([0.0, 0.0, heading_rad])
    T_cup_pad = make_pose(R, np.array(p_cup_tip) - R @ [0.0525, 0.0, 0.0])
    return replace(state, T_world_pads=(state.objects["cup"].T_world_object @ T_cup_pad,))


def beside(gap_m: float) -> TaskState:
    return with_pad([0.08 + gap_m, 0.0, 0.0], heading_rad=math.pi)


def above(gap_m: float) -> TaskState:
    return with_pad([0.0, 0.0, 0.08 + gap_m], heading_rad=0.0)


def before_handle(gap_m: float) -> TaskState:
    return with_pad([0.0, 0.149 + gap_m, 0.0], heading_rad=-math.pi / 2)


def beside_handle(gap_m: float) -> TaskState:
    return with_pad([0.005 + gap_m, 0.149, 0.0], heading_rad=-math.pi / 2)


def above_handle(gap_m: float) -> TaskState:
    return with_pad([0.0, 0.149, 0.05 + gap_m], heading_rad=-math.pi / 2)


def leaning_both_ways() -> TaskState:
    """Cabinet and cup tilted against each other: 12 deg between them, each within its limit."""
    state = tipped(4.0)
    T = state.objects["cup"].T_world_object
    cup = at_rest(make_pose(T[:3, :3] @ exp3([math.radians(-12.0), 0.0, 0.0]), T[:3, 3]))
    return replace(state, objects={**state.objects, "cup": cup})


PLACES = (beside, above, before_handle, beside_handle, above_handle)
INSIDE = [
    shelved(),
    leaning_both_ways(),
    *(shelved((x, 0.05, STANDING_Z_M)) for x in (-0.149, 0.149)),
    *(shelved((0.0, y, STANDING_Z_M)) for y in (-0.049, 0.089)),
    *(shelved((0.0, 0.05, z)) for z in (-0.1099, -0.0901)),
    *(shelved(tilt_deg=tilt) for tilt in (-9.9, 9.9)),
    *(tipped(angle) for angle in (-4.9, 4.9)),
    moving(0.049, 0.49),
    *(place(0.0501) for place in PLACES),
]
OUTSIDE = [
    *(("x", shelved((x, 0.05, STANDING_Z_M))) for x in (-0.151, 0.151)),
    *(("y", shelved((0.0, y, STANDING_Z_M))) for y in (-0.051, 0.091)),
    *(("z", shelved((0.0, 0.05, z))) for z in (-0.1101, -0.0899)),
    *(("cup tilt", shelved(tilt_deg=tilt)) for tilt in (-10.1, 10.1)),
    *(("cabinet tilt", tipped(angle)) for angle in (-5.1, 5.1)),
    *(("rest", moving(v, w)) for v, w in ((0.051, 0.0), (0.0, 0.51))),
    *(("pads", place(0.0499)) for place in PLACES),
    ("grasp", replace(shelved(), grasp=True)),
    ("touch", replace(shelved(), touching_robot=frozenset({"cup"}))),
]


@pytest.mark.parametrize("state", INSIDE)
def test_correct_placements_pass(state: TaskState):
    assert TASK.judge(state).failed == ()


@pytest.mark.parametrize(("condition", "state"), OUTSIDE)
def test_each_condition_fails_alone(condition: str, state: TaskState):
    judgement = TASK.judge(state)
    assert judgement.failed == (NAMES[condition],)
    assert judgement.placed == (condition in ("grasp", "touch", "pads"))


def test_every_condition_has_a_case_outside():
    everything_wrong = replace(
        shelved((1.0, 1.0, 1.0), tilt_deg=90.0, T=tipped(20.0).objects["cabinet"].T_world_object),
        grasp=True,
        touching_robot=frozenset({"cup"}),
    )
    cup = at_rest(everything_wrong.objects["cup"].T_world_object, v=1.0)
    everything_wrong = replace(
        everything_wrong,
        objects={**everything_wrong.objects, "cup": cup},
        T_world_pads=(cup.T_world_object,),
    )
    assert set(TASK.judge(everything_wrong).failed) == {NAMES[name] for name, _ in OUTSIDE}


def test_a_fallen_cup_ends_the_episode():
    state = shelved()
    floor = at_rest(upright(0.2, 0.0, TABLE_TOP_M - 0.101, 0.0))
    assert TASK.judge(state).lost is None
    assert TASK.judge(replace(state, objects={**state.objects, "cup": floor})).lost is not None


def test_success_must_hold_for_half_a_second():
    monitor = SuccessMonitor()
    good, bad = TASK.judge(shelved()), TASK.judge(shelved(tilt_deg=20.0))
    assert not any(monitor.update(good) for _ in range(49))
    assert not monitor.update(bad)
    assert not any(monitor.update(good) for _ in range(49))
    assert monitor.update(good)


def test_the_scene_holds_what_the_task_names():
    model = mujoco.MjSpec.from_string(load_task("cup").scene_xml()).compile()
    bodies = {model.body(body).name for body in range(model.nbody)}
    assert bodies == {"world", "cabinet", "door_left", "door_right", "cup"}
    masses = {name: float(model.body(name).mass[0]) for name in bodies - {"world"}}
    expected = {"cabinet": 5.0, "door_left": 0.162, "door_right": 0.162, "cup": 0.106}
    assert masses == pytest.approx(expected, abs=1e-3)


def test_spawns_fill_their_ranges_and_follow_the_seed():
    grasp, place = (region for region in REGIONS if region.task == "cup")
    seen: dict[str, list[list[float]]] = {"cabinet": [], "cup": []}
    for seed in range(600):
        first = TASK.spawn(np.random.default_rng([seed, 0]))
        again = TASK.spawn(np.random.default_rng([seed, 0]))
        for item, same in zip(first, again, strict=True):
            T = item.T_world_object
            assert T.tobytes() == same.T_world_object.tobytes()
            seen[item.name].append([*T[:3, 3], math.atan2(T[1, 0], T[0, 0])])
    for name, region in (("cup", grasp), ("cabinet", place)):
        drawn = np.array(seen[name])
        for column, bounds in ((0, region.x_m), (1, region.y_m), (3, region.yaw_rad)):
            least, largest = drawn[:, column].min(), drawn[:, column].max()
            assert (least, largest) == pytest.approx(bounds, abs=5e-3)
            assert bounds[0] - 1e-9 <= least
            assert largest <= bounds[1] + 1e-9
        assert drawn[:, 2] == pytest.approx(region.z_m + 0.0005)


def test_the_original_layout_is_120_mm_further_away():
    near, far = (
        {item.name: item.T_world_object for item in task.spawn(np.random.default_rng(3))}
        for task in (TASK, CupTask(layout="original"))
    )
    np.testing.assert_array_equal(near["cup"], far["cup"])
    shift_m = far["cabinet"][:3, 3] - near["cabinet"][:3, 3]
    assert norm(shift_m) == pytest.approx(0.12, abs=5e-4)
    assert near["cabinet"][:3, 3] @ shift_m > 0.0


def make_world(seed: int = 0) -> World:
    return World(task=TASK, robot=load_robot("abstract"), seed=seed)


@pytest.mark.parametrize("seed", range(3))
def test_objects_have_settled_where_they_were_put(seed: int):
    world = make_world(seed)
    states = world.object_states()
    for item in TASK.spawn(np.random.default_rng([seed, 0])):
        way_m, angle_rad = distance(item.T_world_object, states[item.name].T_world_object)
        assert way_m < 2e-3, item.name
        assert angle_rad < 2e-3, item.name
        assert norm(states[item.name].velocity_m_s) < 1e-3
    doors = [float(world.data.joint(f"door_{side}").qpos[0]) for side in ("left", "right")]
    world.advance(1.0)
    assert doors == pytest.approx([1.95, 1.95], abs=0.01)
    for name, state in world.object_states().items():
        assert distance(state.T_world_object, states[name].T_world_object)[0] < 1e-4


def test_a_pushed_door_swings_back():
    world = make_world()
    world.data.joint("door_left").qpos[0] = 1.0
    world.advance(1.5)
    assert 1.6 < float(world.data.joint("door_left").qpos[0]) < 2.1


def test_the_world_tells_where_the_pads_are():
    world = make_world()
    left, right = (
        invert(world.T_world_tool) @ T for T in world.task_state(grasp=False).T_world_pads
    )
    pad_m = 0.5 * opening_m(OPEN_RAD) + 0.0015
    assert left[:3, 3] == pytest.approx([pad_centre_x_m(OPEN_RAD), pad_m, 0.0], abs=1e-3)
    assert right[:3, 3] == pytest.approx([pad_centre_x_m(OPEN_RAD), -pad_m, 0.0], abs=1e-3)
    assert left[:3, :3] == pytest.approx(np.eye(3), abs=1e-9)


def settle(**places: Array) -> tuple[Judgement, World]:
    """Judge what comes of objects placed in the world, a second later."""
    world = make_world()
    for name, T_world_object in places.items():
        start = int(world.model.joint(int(world.model.body(name).jntadr[0])).qposadr[0])
        world.data.qpos[start : start + 7] = pose_to_wire(T_world_object)
    world.advance(1.0)
    return TASK.judge(world.task_state(grasp=False)), world


def in_cabinet(x: float, y: float, z: float, *, turn: Sequence[float] = (0.0, 0.0, 0.0)) -> Array:
    return CABINET @ make_pose(exp3(turn), [x, y, z])


@pytest.mark.parametrize(("x", "y"), [(0.0, 0.05), (0.14, -0.04), (-0.14, 0.085), (0.0, -0.04)])
def test_a_cup_that_was_stood_on_the_shelf_passes(x: float, y: float):
    judgement, _ = settle(cabinet=CABINET, cup=in_cabinet(x, y, STANDING_Z_M + 0.001))
    assert judgement.holds


LYING = (math.pi / 2, 0.0, 0.0)
ON_ITS_BACK = upright(0.80, -0.55, TABLE_TOP_M + 0.151, 0.0) @ make_pose(
    exp3([math.pi / 2, 0.0, 0.0]), [0.0, 0.0, 0.0]
)
CHEATS = {
    "lying on the shelf": ({"cup": in_cabinet(0.0, 0.03, -0.09, turn=LYING)}, {"cup tilt"}),
    "upside down": ({"cup": in_cabinet(0.0, 0.05, -0.099, turn=(0, math.pi, 0))}, {"cup tilt"}),
    "half out": ({"cup": in_cabinet(0.0, 0.12, -0.099)}, {"y"}),
    "on the table": ({"cup": in_cabinet(0.0, 0.30, -0.169)}, {"y", "z"}),
    "on the roof": ({"cup": in_cabinet(0.0, 0.05, 0.281)}, {"z"}),
    "beside the cabinet": ({"cup": in_cabinet(0.40, 0.0, -0.169)}, {"x", "z"}),
    "in a cabinet on its back": (
        {"cabinet": ON_ITS_BACK, "cup": upright(0.80, -0.55, TABLE_TOP_M + 0.11, 0.0)},
        {"cabinet tilt"},
    ),
}


@pytest.mark.parametrize("cheat", CHEATS)
def test_cheats_fail(cheat: str):
    places, conditions = CHEATS[cheat]
    judgement, world = settle(**({"cabinet": CABINET} | places))
    assert norm(world.object_states()["cup"].velocity_m_s) < 0.05
    assert {NAMES[name] for name in conditions} <= set(judgement.failed)


def test_a_cup_in_the_hand_above_the_shelf_fails():
    held = replace(shelved((0.0, 0.05, -0.08)), grasp=True, touching_robot=frozenset({"cup"}))
    assert set(TASK.judge(held).failed) == {NAMES[name] for name in ("grasp", "touch", "z")}
    let_go, world = settle(cabinet=CABINET, cup=in_cabinet(0.0, 0.05, -0.05))
    assert let_go.holds
    assert tilt_of(world.object_states()["cup"].T_world_object) < 0.02
