"""Servos of a simulated robot: what a command's latency does, and what holding means."""

import mujoco
import numpy as np
import pytest
from pydantic import ValidationError

from common.clock import TICK_S
from common.errors import InvalidValue
from common.robots import RobotSpec, list_robots, load_robot
from common.tasks import load_task
from services.sim.world import PHYSICS_DT_S, World

PANDA = load_robot("panda")
START = np.array(PANDA.start_positions)
TICKS = 3


def make_world(latency_s: float = 0.0, robot: RobotSpec = PANDA) -> World:
    spec = robot.model_copy(update={"command_latency_s": latency_s})
    return World(task=load_task("lid"), robot=spec, seed=0)


def controls(world: World) -> np.ndarray:
    """What the servos want at the end of a tick."""
    world.advance(TICK_S)
    return world.data.ctrl[: len(START)].copy()


def wiggle(tick: int) -> tuple[list[float], list[float]]:
    shape = np.linspace(0.5, 1.0, len(START))
    return (START + 0.02 * np.sin(0.2 * tick) * shape).tolist(), (0.4 * shape).tolist()


def test_a_latency_of_three_ticks_delays_exactly_three_ticks():
    prompt, late = make_world(), make_world(TICKS * TICK_S)
    at_once, delayed = [], []
    for tick in range(20):
        for world, seen in ((prompt, at_once), (late, delayed)):
            world.servos.command(*wiggle(tick))
            seen.append(controls(world))
    assert np.array_equal(delayed[:TICKS], [START] * TICKS)
    assert np.array_equal(delayed[TICKS:], at_once[:-TICKS])
    # Each command is another one, so that no other shift fits.
    assert len({tuple(control) for control in at_once}) == len(at_once)


def test_set_points_between_ticks_are_delayed_as_well():
    worlds = make_world(), make_world(TICKS * TICK_S)
    halves = []
    for world in worlds:
        halves.append([])
        for tick in range(10):
            world.servos.command(*wiggle(tick))
            world.servos.start_tick(2)
            world.servos.apply(world.data, 0)
            halves[-1].append(world.data.ctrl[: len(START)].copy())
    assert np.array_equal(halves[1][TICKS:], halves[0][:-TICKS])


def test_a_hold_rests_at_the_last_command_once_all_have_had_their_effect():
    world = make_world(TICKS * TICK_S)
    for tick in range(8):
        world.servos.command(*wiggle(tick))
        controls(world)
    seen = []
    for _ in range(6):
        world.servos.hold()
        seen.append(controls(world))
    last = np.array(wiggle(7)[0])
    assert not np.array_equal(seen[TICKS - 1], last)
    assert np.array_equal(seen[TICKS:], [last] * 3)


def test_a_reset_forgets_what_is_under_way():
    world = make_world(TICKS * TICK_S)
    for tick in range(1, 8):
        world.servos.command(*wiggle(tick))
        controls(world)
    world.servos.reset(world.data)
    for _ in range(2 * TICKS):
        world.servos.hold()
        assert np.array_equal(controls(world), START)


def test_a_free_hand_takes_commands_at_once():
    hand = load_robot("abstract")
    with pytest.raises(ValidationError, match="takes commands at once"):
        RobotSpec.model_validate({**dict(hand), "command_latency_s": 0.03})


@pytest.mark.parametrize("bad", [[0.0] * 4, [0.5, 0.5, 0.5, 0.4], [2.0, 0.0, 0.0, 0.0]])
def test_a_commanded_quaternion_must_be_one(bad: list[float]):
    world = make_world(robot=load_robot("abstract"))
    with pytest.raises(InvalidValue, match=r"quaternion .* expected length 1"):
        world.servos.command([0.1, -0.3, 0.8, *bad], [0.0] * 6)


def test_a_command_that_is_not_finite_is_refused():
    world = make_world()
    with pytest.raises(InvalidValue, match="finite numbers"):
        world.servos.command([float("nan")] * len(START), [0.0] * len(START))


@pytest.mark.parametrize("name", [n for n in list_robots() if load_robot(n).kind == "joints"])
def test_a_clipped_servo_does_not_chatter(name):
    """Without implicit damping a step multiplies a velocity by 1 - kd dt / M, not beyond -1."""
    spec = load_robot(name)
    world = World(task=load_task("lid"), robot=spec, seed=0)
    n = world.model.nv
    inverse_inertia = np.zeros((n, n))
    mujoco.mj_solveM(world.model, world.data, inverse_inertia, np.eye(n))
    for joint in spec.joints:
        dof = int(world.model.joint(f"robot_{joint.name}").dofadr[0])
        assert joint.kd * PHYSICS_DT_S * inverse_inertia[dof, dof] < 2.0, joint.name
