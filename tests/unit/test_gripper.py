from __future__ import annotations

import pytest

from common import messages as m
from common.calibration.four_bar import OPEN_RAD, opening_m
from services.gripper.driver import Driver, DriverConfig
from services.gripper.motors import MotorReading, SimulatedMotors
from services.gripper.reactor import GripperReactor
from tests.strangers import STRANGER, by_stranger, dropped, strangers_told

CELL = "sim-0"


def reading(position: float, *, velocity: float = 0.0, current: float = 0.0) -> MotorReading:
    return MotorReading((position,) * 2, (velocity,) * 2, (current,) * 2)


def test_the_setpoint_ramps_and_arrives():
    motors = SimulatedMotors()
    driver = Driver(motors, DriverConfig())
    motors.receive(reading(OPEN_RAD))
    driver.grasp = True
    goals = []
    for _ in range(100):
        driver.step()
        assert motors.goal is not None
        goals.append(motors.goal.positions_rad[0])
    steps = [a - b for a, b in zip([OPEN_RAD, *goals], goals, strict=False)]
    assert max(steps) == pytest.approx(0.01)
    assert goals[77] > 0.0
    assert goals[78] == 0.0
    assert motors.goal == motors.goal.__class__((0.0, 0.0), DriverConfig().current_limit_a)


@pytest.mark.parametrize(
    ("grasp", "velocity", "current", "gripped"),
    [
        (True, 0.0, -0.6, True),
        (True, 0.0, -0.3, False),
        (True, 0.2, -0.6, False),
        (False, 0.0, -0.6, False),
    ],
)
def test_grip_is_closed_still_and_at_the_cap(
    grasp: bool, velocity: float, current: float, gripped: bool
):
    motors = SimulatedMotors()
    driver = Driver(motors, DriverConfig())
    driver.grasp = grasp
    motors.receive(reading(0.22, velocity=velocity, current=current))
    report = driver.step()
    assert report.gripped is gripped
    assert report.opening_m == pytest.approx(opening_m(0.22))


def test_stepping_before_the_first_reading_is_an_error():
    with pytest.raises(RuntimeError, match="not been read"):
        Driver(SimulatedMotors(), DriverConfig()).step()


def header(step: int = 0, *, source: str = CELL) -> m.Header:
    return m.Header(
        cell=CELL, episode="e", epoch=1, source=source, step=step, t_mono_ns=1000 + step
    )


def configure(mode: m.Mode = "lockstep", node: str = "gripper") -> m.EpisodeConfigure:
    return m.EpisodeConfigure(
        header=header(),
        task="lid",
        robot="abstract",
        policy="expert",
        seed=0,
        mode=mode,
        nodes={"sim": CELL, "gripper": node, "policy": "policy"},
    )


def state(step: int, due: int = -1) -> m.MotorState:
    return m.MotorState(
        header=header(step),
        positions_rad=[OPEN_RAD] * 2,
        velocities_rad_s=[0.0] * 2,
        currents_a=[0.0] * 2,
        due_frame_step=due,
    )


def action(for_step: int, *, grasp: bool) -> m.PolicyAction:
    step = m.ActionStep(translation_m=[0.0] * 3, rotation_rad=[0.0] * 3, grasp=grasp)
    return m.PolicyAction(
        header=header(for_step, source="policy"),
        for_step=for_step,
        request_t_mono_ns=0,
        steps=[step],
        inference_s=0.0,
    )


def ready_reactor(mode: m.Mode = "lockstep") -> GripperReactor:
    reactor = GripperReactor(node="gripper")
    (ready,) = reactor.handle([configure(mode)])
    assert isinstance(ready, m.EpisodeReady)
    assert ready.problem is None
    return reactor


def test_it_serves_only_cells_that_chose_it():
    reactor = GripperReactor(node="gripper")
    assert list(reactor.handle([configure(node="another")])) == []
    assert not reactor.serves(CELL)
    assert list(reactor.handle([state(0)])) == []


def test_a_due_tick_waits_for_its_action():
    reactor = ready_reactor()
    assert list(reactor.handle([state(0, due=0)])) == []
    command, gripper_state = reactor.handle([action(0, grasp=True)])
    assert isinstance(command, m.MotorCommand)
    assert command.for_step == 0
    assert command.request_t_mono_ns == 1000
    assert command.positions_rad[0] == pytest.approx(OPEN_RAD - 0.01)
    assert isinstance(gripper_state, m.GripperState)
    assert gripper_state.grasp


def test_an_action_that_came_first_is_used():
    reactor = ready_reactor()
    assert list(reactor.handle([action(0, grasp=True)])) == []
    command, _ = reactor.handle([state(0, due=0)])
    assert isinstance(command, m.MotorCommand)


def test_an_action_waits_for_its_tick_while_newer_ones_come():
    """With a latency above 0.1 s they do."""
    reactor = ready_reactor()
    for frame, grasp in ((0, True), (10, False)):
        assert list(reactor.handle([action(frame, grasp=grasp)])) == []
    for step, due, grasp in ((20, 0, True), (30, 10, False)):
        _, gripper_state = reactor.handle([state(step, due=due)])
        assert isinstance(gripper_state, m.GripperState)
        assert gripper_state.grasp is grasp


def test_the_same_tick_is_answered_from_memory():
    reactor = ready_reactor()
    first = list(reactor.handle([action(0, grasp=True), state(0, due=0)]))
    second = list(reactor.handle([state(0, due=0)]))
    assert first == second
    (command,) = reactor.handle([state(1)])
    assert isinstance(command, m.MotorCommand)
    assert command.positions_rad[0] == pytest.approx(OPEN_RAD - 0.02)
    assert list(reactor.handle([state(0, due=0)])) == []


def test_in_real_time_the_newest_action_counts_at_once():
    reactor = ready_reactor("realtime")
    reactor.handle([action(0, grasp=True)])
    command, *_ = reactor.handle([state(3)])
    assert isinstance(command, m.MotorCommand)
    assert command.positions_rad[0] < OPEN_RAD


def test_in_lockstep_strangers_move_nothing_and_get_no_answer(caplog):
    reactor = ready_reactor()
    first, close = state(0, due=0), action(0, grasp=True)
    assert list(reactor.handle([by_stranger(close), by_stranger(first), first])) == []
    command, gripper_state = reactor.handle([action(0, grasp=False)])
    assert isinstance(gripper_state, m.GripperState)
    assert not gripper_state.grasp
    # Not from memory either.
    assert list(reactor.handle([by_stranger(first)])) == []
    assert list(reactor.handle([first])) == [command, gripper_state]
    assert dropped(reactor) == {"gripper/motor_state": 2, "policy/action": 1}
    assert strangers_told(caplog) == [STRANGER]


def test_in_real_time_a_stranger_closes_no_gripper(caplog):
    reactor = ready_reactor("realtime")
    assert list(reactor.handle([by_stranger(action(0, grasp=True))])) == []
    command, *_ = reactor.handle([state(3)])
    assert isinstance(command, m.MotorCommand)
    assert command.positions_rad[0] == OPEN_RAD
    reactor.handle([action(0, grasp=True)])
    command, *_ = reactor.handle([state(4)])
    assert command.positions_rad[0] < OPEN_RAD
    assert strangers_told(caplog) == [STRANGER]


def test_an_episode_that_names_no_simulation_and_no_policy_is_a_problem():
    reactor = GripperReactor(node="gripper")
    lonely = configure().model_copy(update={"nodes": {"gripper": "gripper"}})
    (ready,) = reactor.handle([lonely])
    assert isinstance(ready, m.EpisodeReady)
    assert ready.problem is not None
    assert ready.problem.expected == "expected also policy, sim"
    assert not reactor.serves(CELL)


def test_abort_forgets_the_cell():
    reactor = ready_reactor()
    reactor.handle([m.EpisodeAbort(header=header(), reason="test")])
    assert not reactor.serves(CELL)
