"""The simulated world: start, servos, fingers, clean reset."""

from __future__ import annotations

import numpy as np
import pytest

from common.calibration.four_bar import OPEN_RAD, opening_m
from common.clock import TICK_S
from common.errors import WrongShape
from common.robots import list_robots, load_robot
from common.se3 import distance, exp3, log3, make_pose, pose_from_wire, quat_from_matrix
from common.tasks import load_task
from services.sim.world import World

START = pose_from_wire([0.1, -0.3, 0.8, 1.0, 0.0, 0.0, 0.0])


def make_world(robot: str = "abstract", seed: int = 0) -> World:
    return World(task=load_task("lid"), robot=load_robot(robot), seed=seed)


@pytest.mark.parametrize("robot", list_robots())
def test_every_robot_starts_at_the_same_tool_pose_and_at_rest(robot: str):
    world = make_world(robot)
    way_m, angle_rad = distance(world.T_world_tool, START)
    assert way_m < 1e-3
    assert angle_rad < 2e-3
    assert np.abs(world.data.qvel).max() < 1e-2
    assert len(world.servos.positions(world.data)) == load_robot(robot).nq
    assert len(world.servos.velocities(world.data)) == load_robot(robot).nv


@pytest.mark.parametrize("robot", list_robots())
def test_objects_have_settled_where_they_were_put(robot: str):
    world = make_world(robot, seed=4)
    poses = {k: pose_from_wire(v) for k, v in world.object_poses().items()}
    for item in world.task.spawn(np.random.default_rng([4, 0])):
        way_m, angle_rad = distance(item.T_world_object, poses[item.name])
        assert way_m < 2e-3, item.name
        assert angle_rad < 0.01, item.name
    assert poses["pot"][2, 3] == pytest.approx(0.72, abs=1e-3)


@pytest.mark.parametrize("robot", list_robots())
def test_a_world_is_the_same_whatever_was_simulated_before(robot: str):
    def fingerprint(seed: int) -> bytes:
        world = make_world(robot, seed)
        for _ in range(5):
            world.advance(TICK_S)
        return world.data.qpos.tobytes() + world.data.qvel.tobytes()

    first = fingerprint(1)
    fingerprint(2)
    assert fingerprint(1) == first
    assert fingerprint(2) != first


def test_published_masses():
    world = make_world()
    masses = {"stove": 1.44, "pot": 0.395, "lid": 0.162}
    for name, mass in masses.items():
        assert world.model.body(name).subtreemass[0] == pytest.approx(mass, abs=1e-9)
    gripper = world.model.body("gripper_mount").subtreemass[0]
    assert gripper == pytest.approx(0.24888, abs=1e-9)
    # The paper's simulation had a lid inertia about 80 times too large.
    assert world.model.body("lid").inertia.max() < 1e-3


def test_the_abstract_hand_does_not_sag_and_turns_about_compound_axes():
    """The paper's simulation sagged 44 mm and mixed up its Euler order (50 deg off)."""
    world = make_world()
    T_goal = make_pose(
        exp3([0.0, 0.0, 1.2]) @ exp3([0.0, 0.78, 0.0]) @ exp3([0.3, 0.0, 0.0]), [0.2, -0.2, 0.95]
    )
    start, n = START, 100
    for i in range(1, n + 150):
        s = min(1.0, i / n)
        p = start[:3, 3] + s * (T_goal[:3, 3] - start[:3, 3])
        R = exp3(s * log3(T_goal[:3, :3]))
        world.servos.command([*p, *quat_from_matrix(R)], [0.0] * 6)
        world.advance(TICK_S)
    way_m, angle_rad = distance(world.T_world_tool, T_goal)
    assert way_m < 1e-3
    assert angle_rad < 0.01


@pytest.mark.parametrize(("goal_rad", "opening"), [(0.2, 0.0223), (0.5, 0.0672)])
def test_fingers_reach_their_goal_without_turning(goal_rad: float, opening: float):
    world = make_world()
    world.fingers.command([goal_rad, goal_rad], current_limit_a=0.6)
    for _ in range(100):
        world.advance(TICK_S)
    assert world.fingers.opening_m(world.data) == pytest.approx(opening, abs=1e-3)
    assert opening_m(goal_rad) == pytest.approx(opening, abs=1e-4)
    base = world.data.body("gripper_base").xmat
    for side in ("left", "right"):
        finger = world.data.body(f"gripper_{side}_finger").xmat
        np.testing.assert_allclose(finger, base, atol=5e-3)
    # Both pads are equally far from the middle plane.
    pads = [world.data.geom(f"gripper_{side}_pad").xpos[1] for side in ("left", "right")]
    assert pads[0] + pads[1] == pytest.approx(2 * START[1, 3], abs=1e-3)


def test_the_current_cap_bounds_the_motor():
    world = make_world()
    world.fingers.command([0.0, 0.0], current_limit_a=0.3)
    for _ in range(120):
        world.advance(TICK_S)
    # Closed on nothing but each other: the pads press with the capped current.
    currents = world.fingers.currents_a(world.data)
    assert max(abs(i) for i in currents) <= 0.3 + 1e-9
    assert world.fingers.positions_rad(world.data)[0] < OPEN_RAD


def test_a_command_of_the_wrong_length_is_refused():
    world = make_world()
    with pytest.raises(WrongShape) as caught:
        world.servos.command([0.0] * 3, [0.0] * 6)
    assert (caught.value.expected_length, caught.value.got_length) == (7, 3)


def test_touching_names_the_object_between_robot_and_scene():
    world = make_world()
    assert world.task_state(grasp=False).touching_robot == frozenset()
    lid = pose_from_wire(world.object_poses()["lid"])[:3, 3]
    # Push the fingers down onto the lid.
    goal = lid + [-0.29, 0.0, 0.02]
    start = START[:3, 3]
    for i in range(1, 200):
        s = min(1.0, i / 150)
        world.servos.command([*(start + s * (goal - start)), 1.0, 0.0, 0.0, 0.0], [0.0] * 6)
        world.advance(TICK_S)
    assert "lid" in world.task_state(grasp=False).touching_robot
