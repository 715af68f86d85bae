"""A robot in motion loses its commands or its policy: it is at rest within 0.3 s, and holds."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.safe_stop.cell import FAULTS, Fault, FaultyCell, open_cell
from benchmarks.safe_stop.record import DRIFT_LIMIT_M, STOP_LIMIT_S, Stop, measure_stop
from common.clock import TICK_S
from common.errors import EmergencyStopped, StaleCommand
from common.messages import ActionStep, RobotCommand, RobotState
from common.robots import list_robots, load_robot
from common.safety import SafetyLatch, Setpoint
from common.se3 import pose_to_wire
from common.tasks import load_task
from services.retarget.reactor import RetargetReactor
from services.sim.body import GuardedBody
from services.sim.world import World
from tests.retarget_runs import NODE, action, configure, header

SPEED_M_S, TURN_RAD_S = 0.3, 0.3
"""The expert's fastest."""
DIRECTION = (-0.6, 0.0, 0.8)
"""Back and up, in the tool's frame."""
FAULT_TICK, TICKS = 45, 150


class Motion:
    """A retargeter leads a guarded robot one way at an even speed, in real time."""

    def __init__(self, robot: str) -> None:
        self.latch = SafetyLatch()
        world = World(task=load_task("lid"), robot=load_robot(robot), seed=0)
        self.body = GuardedBody(world, self.latch, epoch=1)
        self.body.guard.start()
        self.poses: list[list[float]] = []
        self.policy_speaks = self.retargeter_answers = True
        self._retargeter = RetargetReactor(node=NODE, robots=[robot])
        self._retargeter.handle([configure(robot, mode="realtime")])
        self._step = ActionStep(
            translation_m=[0.1 * SPEED_M_S * each for each in DIRECTION],
            rotation_rad=[0.1 * TURN_RAD_S, 0.0, 0.0],
            grasp=False,
        )

    def tick(self) -> None:
        tick, world = len(self.poses), self.body.world
        if self.policy_speaks and tick % 10 == 0:
            # A chunk: what is left of it must not be played when the policy is gone.
            self._retargeter.handle([action(tick, *[self._step] * 16)])
        if self.retargeter_answers:
            state = RobotState(
                header=header(tick),
                positions=world.servos.positions(world.data),
                velocities=world.servos.velocities(world.data),
            )
            *_, command = self._retargeter.handle([state])
            assert isinstance(command, RobotCommand)
            self.body.guard.offer(
                Setpoint(command.positions, command.velocities), made_s=tick * TICK_S
            )
        self.body.command()
        self.body.advance()
        self.poses.append(pose_to_wire(world.T_world_tool))


def check(stop: Stop) -> None:
    assert stop.speed_m_s > 0.5 * SPEED_M_S
    assert stop.stop_s <= STOP_LIMIT_S, stop
    assert stop.drift_m <= DRIFT_LIMIT_M, stop


@pytest.mark.parametrize("loss", ["commands", "policy", "emergency"])
@pytest.mark.parametrize("robot", list_robots())
def test_a_moving_robot_comes_to_rest_and_holds(robot: str, loss: str):
    motion = Motion(robot)
    for tick in range(TICKS):
        if tick == FAULT_TICK:
            motion.retargeter_answers = loss != "commands"
            motion.policy_speaks = loss != "policy"
            if loss == "emergency":
                motion.body.guard.stop(EmergencyStopped("cell", "test", ""))
        motion.tick()
    check(measure_stop(motion.poses, FAULT_TICK))
    fault = motion.latch.fault
    expected = {"commands": StaleCommand, "policy": type(None), "emergency": EmergencyStopped}
    assert isinstance(fault, expected[loss])
    counts = motion.body.guard.counts
    assert (counts.position_clamps, counts.velocity_clamps, counts.acceleration_clamps) == (0, 0, 0)


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    folder: Path = tmp_path_factory.mktemp("safe-stop")
    with open_cell(folder, list_robots()) as opened:
        yield opened


@pytest.mark.chaos
@pytest.mark.processes
@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("robot", list_robots())
def test_over_processes_a_moving_robot_comes_to_rest_and_holds(
    cell: FaultyCell, robot: str, fault: Fault
):
    stop = cell.measure(robot, fault).stop
    assert stop.held_s >= 0.9
    assert stop.good, stop
