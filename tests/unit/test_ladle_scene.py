"""The ladle's scene: what is in it, how it starts, and where the hand must get."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from common.se3 import distance
from common.tasks import list_tasks, load_task
from common.tasks.ladle import POT_YAW_RAD, LadleTask
from common.tasks.poses import upright, yaw_of
from common.tasks.task import DemonstratorView
from common.tasks.workspaces import REGIONS, HandTurn
from tests.ladle_world import make_ladle_world, pose

task = LadleTask()


def test_the_scene_holds_the_ladle_and_no_other_task_does():
    """The paper's code builds the ladle's scene when asked for the cup, and the reverse."""
    for name in list_tasks():
        model = mujoco.MjModel.from_xml_string(load_task(name).scene_xml())
        bodies = {model.body(i).name for i in range(model.nbody)}
        assert ({"ladle", "case"} <= bodies) == (name == "ladle")
        assert set(load_task(name).objects) <= bodies


def test_published_masses_and_sizes():
    world = make_ladle_world()
    masses = {"stove": 1.44, "pot": 0.395, "ladle": 0.208, "case": 4.98}
    for name, mass in masses.items():
        assert world.model.body(name).subtreemass[0] == pytest.approx(mass, abs=1e-9)
    table = world.model.geom("table")
    (obstacle,) = task.obstacles
    assert table.size.tolist() == pytest.approx([0.375, 1.0, 0.025])
    assert obstacle.half_size_m == pytest.approx(table.size)
    assert obstacle.T_world_box[:3, 3] == pytest.approx(table.pos)


def test_spawns_stay_in_their_ranges_and_follow_the_seed():
    turns: list[float] = []
    for seed in range(200):
        first = task.spawn(np.random.default_rng([seed, 0]))
        again = task.spawn(np.random.default_rng([seed, 0]))
        assert [item.name for item in first] == list(task.objects)
        poses = {item.name: item.T_world_object for item in first}
        for item in again:
            np.testing.assert_array_equal(poses[item.name], item.T_world_object)
        stove, pot, case = (poses[name] for name in ("stove", "pot", "case"))
        assert stove[:3, 3] == pytest.approx([0.60, pot[1, 3], 0.6255])
        assert 0.18 <= stove[1, 3] <= 0.42
        assert pot[0, 3] == pytest.approx(0.60)
        assert case[[0, 2], 3] == pytest.approx([0.5625, 0.6355])
        assert -0.42 <= case[1, 3] <= -0.38
        assert 67.5 <= math.degrees(math.atan2(case[1, 0], case[0, 0])) <= 112.5
        x, y, _ = (poses["ladle"][:3, 3] - pot[:3, 3]).tolist()
        turns.append(math.degrees(math.atan2(-y, -x) - POT_YAW_RAD))
    assert -15.0 <= min(turns) < -13.0
    assert 13.0 < max(turns) <= 15.0


@pytest.mark.parametrize("seed", range(8))
def test_objects_have_settled_where_they_were_put(seed: int):
    """Whatever the ladle's turn, it stands where it was put, and so firmly that it falls asleep."""
    world = make_ladle_world(seed=seed)
    for item in task.spawn(np.random.default_rng([seed, 0])):
        way_m, angle_rad = distance(item.T_world_object, pose(world, item.name))
        assert way_m < 2e-3, item.name
        assert angle_rad < 0.012, item.name
    for state in world.object_states().values():
        assert not state.velocity_m_s.any()
        assert not state.velocity_rad_s.any()
    assert world.task_state(grasp=False).touching_robot == frozenset()


def test_the_start_does_not_depend_on_the_robot():
    starts = [
        make_ladle_world(robot, seed=3).object_poses() for robot in ("abstract", "panda", "spot")
    ]
    assert starts[0] == starts[1] == starts[2]


def test_the_workspaces_are_where_the_demonstrator_grasps_and_lays():
    grasp, place = (region for region in REGIONS if region.task == "ladle")
    for seed in range(200):
        spawned = {i.name: i.T_world_object for i in task.spawn(np.random.default_rng(seed))}
        pot, ladle, case = (spawned[name] for name in ("pot", "ladle", "case"))
        assert grasp.y_m[0] <= pot[1, 3] <= grasp.y_m[1]
        assert place.y_m[0] <= case[1, 3] <= place.y_m[1]
        assert place.yaw_rad[0] <= yaw_of(case) <= place.yaw_rad[1]
        yaw = math.atan2(ladle[1, 2], ladle[0, 2])
        assert grasp.yaw_rad[0] <= yaw <= grasp.yaw_rad[1]
        view = DemonstratorView(np.eye(4), spawned, 0.104)
        script = task.script(np.random.default_rng(seed))
        _, reach = script.next_waypoint(view), script.next_waypoint(view)
        assert reach is not None
        T_reach = reach.T_world_tool
        assert T_reach is not None
        pitch = math.asin(-float(T_reach[2, 0]))
        assert grasp.pitch_rad[0] <= pitch <= grasp.pitch_rad[1]
        T_pot_turned = upright(0.60, pot[1, 3], grasp.z_m, yaw)
        T_region = grasp.place_tool(T_pot_turned, HandTurn(pitch_rad=pitch, yaw_rad=0.0))
        assert distance(T_region, T_reach)[0] < 0.02
