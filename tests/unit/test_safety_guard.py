"""The guard between commands and servos, without a robot."""

from __future__ import annotations

import itertools

import pytest

from common import messages as m
from common.clock import TICK_S
from common.errors import EmergencyStopped, InvalidValue, StaleCommand, WrongShape
from common.metrics.table import FAULTS, FOREIGN
from common.robots import list_robots, load_robot
from common.robots.compile import compile_robot, read_ranges
from common.safety import (
    ForeignCounts,
    Guard,
    RobotLimits,
    SafetyLatch,
    Setpoint,
    SingleWriter,
    read_limits,
)
from common.safety.limits import AxisLimits
from tests import retarget_runs

AXES = (
    AxisLimits(-1.0, 1.0, velocity=1.0, acceleration=5.0, stop_acceleration=10.0),
    AxisLimits(
        -float("inf"), float("inf"), velocity=2.0, acceleration=10.0, stop_acceleration=20.0
    ),
)
LIMITS = RobotLimits(AXES, free_hand=False)


def make_guard(*, started: bool = True, latch: SafetyLatch | None = None) -> Guard:
    guard = Guard(LIMITS, [0.0, 0.0], latch=latch or SafetyLatch())
    if started:
        guard.start()
    return guard


def even(tick: int, v: tuple[float, float] = (0.04, -0.08)) -> Setpoint:
    """A motion at an even velocity that both axes may leap to."""
    return Setpoint([v_i * TICK_S * (tick + 1) for v_i in v], list(v))


def run(guard: Guard, ticks: int, *, first: int = 0) -> Setpoint:
    setpoint = Setpoint([], [])
    for tick in range(first, first + ticks):
        guard.offer(even(tick), made_s=tick * TICK_S)
        setpoint = guard.step(tick * TICK_S)
    return setpoint


def test_it_begins_stopped_and_holds_whatever_it_is_told():
    guard = make_guard(started=False)
    assert guard.status == "stopped"
    guard.offer(even(0), made_s=0.0)
    assert guard.step(0.0) == ([0.0, 0.0], [0.0, 0.0])


def test_before_the_first_command_it_waits_for_as_long_as_it_takes():
    guard = make_guard()
    assert guard.step(100.0) == ([0.0, 0.0], [0.0, 0.0])
    assert (guard.status, guard.following) == ("running", False)


def test_what_keeps_to_the_limits_passes_as_it_is():
    guard = make_guard()
    for tick in range(20):
        command = even(tick)
        guard.offer(command, made_s=tick * TICK_S)
        assert guard.step(tick * TICK_S) is command
    assert not any(vars(guard.counts).values())


def test_between_commands_it_goes_on_and_after_the_age_limit_it_brakes():
    latch = SafetyLatch()
    guard = make_guard(latch=latch)
    x = run(guard, 10).positions[0]
    for missed in range(1, 6):
        setpoint = guard.step((9 + missed) * TICK_S)
        assert setpoint.positions[0] == pytest.approx(x + missed * 0.04 * TICK_S)
    assert guard.status == "running"
    guard.step(15 * TICK_S)
    assert isinstance(latch.fault, StaleCommand)
    assert latch.fault.age_s == pytest.approx(0.06)
    assert guard.status == "stopped"
    assert guard.counts.coasted_ticks == 5


def test_a_stop_brakes_as_hard_as_it_may_and_no_harder():
    guard = make_guard()
    for tick in range(100):
        # Faster than an axis may get in one tick: it is led there.
        guard.offer(even(tick, (0.9, -1.8)), made_s=tick * TICK_S)
        setpoint = guard.step(tick * TICK_S)
    assert setpoint.velocities == pytest.approx([0.9, -1.8])
    guard.stop()
    speeds = [setpoint.velocities]
    while guard.status == "stopping":
        speeds.append(guard.step(2.0).velocities)
    for before, after in itertools.pairwise(speeds):
        assert abs(after[0] - before[0]) <= 10.0 * TICK_S + 1e-9
        assert abs(after[1] - before[1]) <= 20.0 * TICK_S + 1e-9
    assert len(speeds) in (10, 11)
    at_rest = guard.step(3.0)
    assert at_rest.velocities == [0.0, 0.0]
    assert guard.step(4.0) == at_rest


def test_a_stopped_guard_follows_nobody_until_it_is_started_again():
    guard = make_guard()
    run(guard, 5)
    guard.stop()
    at = [run(guard, 1, first=tick).positions for tick in range(5, 15)][-1]
    assert run(guard, 1, first=15).positions == at
    guard.start()
    assert run(guard, 1, first=16).positions != at


def test_a_late_command_is_caught_up_with_and_not_overshot():
    guard = make_guard()
    run(guard, 5)
    far = Setpoint([0.05, 0.0], [0.0, 0.0])
    seen = []
    for tick in range(5, 60):
        guard.offer(far, made_s=tick * TICK_S)
        seen.append(guard.step(tick * TICK_S).positions[0])
    assert max(seen) <= 0.05 + 1e-9
    assert seen[-1] == pytest.approx(0.05)
    assert guard.counts.acceleration_clamps > 0


def test_a_position_beyond_its_range_is_held_at_the_end_of_it():
    guard = make_guard()
    seen = []
    for tick in range(400):
        guard.offer(even(tick, (0.5, 0.0)), made_s=tick * TICK_S)
        seen.append(guard.step(tick * TICK_S).positions[0])
    assert max(seen) <= 1.0 + 1e-6
    assert seen[-1] == pytest.approx(1.0, abs=1e-3)
    assert guard.counts.position_clamps > 100


def test_an_older_command_is_no_use():
    guard = make_guard()
    run(guard, 10)
    guard.offer(Setpoint([0.5, 0.5], [0.0, 0.0]), made_s=0.03)
    guard.step(10 * TICK_S)
    assert guard.counts.coasted_ticks == 1


@pytest.mark.parametrize(
    ("command", "error"),
    [
        (Setpoint([0.0], [0.0, 0.0]), WrongShape),
        (Setpoint([0.0, 0.0], [0.0] * 3), WrongShape),
        (Setpoint([float("nan"), 0.0], [0.0, 0.0]), InvalidValue),
        (Setpoint([0.0, 0.0], [float("inf"), 0.0]), InvalidValue),
    ],
)
def test_what_is_no_command_is_a_fault(command: Setpoint, error: type[Exception]):
    latch = SafetyLatch()
    guard = make_guard(latch=latch)
    at = run(guard, 5).positions
    guard.offer(command, made_s=0.05)
    assert guard.step(0.05).positions == pytest.approx(at, abs=1e-3)
    assert isinstance(latch.fault, error)
    with pytest.raises(error):
        guard.start()


def test_an_emergency_stop_outranks_a_fault_and_only_a_reset_releases_it():
    latch = SafetyLatch()
    latch.engage(StaleCommand(0.06, 0.05))
    latch.engage(EmergencyStopped("sim-0", "button", ""))
    latch.engage(StaleCommand(0.07, 0.05))
    assert latch.emergency
    with pytest.raises(EmergencyStopped, match="emergency stop of sim-0 by button"):
        latch.open_episode()
    latch.reset()
    latch.open_episode()
    assert latch.fault is None
    latch.engage(StaleCommand(0.06, 0.05))
    latch.open_episode()
    assert latch.fault is None


def test_a_strangers_message_is_counted_and_told_of_once(caplog):
    counts = ForeignCounts(m.RobotState, m.PolicyAction)
    writer = SingleWriter(retarget_runs.configure(), counts)
    state, action = retarget_runs.state(0), retarget_runs.action(0)
    assert writer.accepts(state)
    assert writer.accepts(action)
    for message in (state, state, action):
        assert not writer.accepts(message.stamped(source="x", seq=1, t_mono_ns=0))
    # The name of a node of another kind does not help.
    assert not writer.accepts(action.stamped(source=retarget_runs.SIM, seq=1, t_mono_ns=0))
    assert writer.foreign == 4
    told = [(record.from_node, record.writer, record.cell) for record in caplog.records]
    assert told == [
        ("x", retarget_runs.SIM, retarget_runs.CELL),
        (retarget_runs.SIM, retarget_runs.POLICY, retarget_runs.CELL),
    ]


def test_foreign_messages_are_counted_by_topic_over_episodes():
    counts = ForeignCounts(m.RobotState, m.PolicyAction)
    for epoch in (1, 2):
        writer = SingleWriter(retarget_runs.configure(epoch=epoch), counts)
        assert not writer.accepts(
            retarget_runs.state(0, epoch=epoch).stamped(source="x", seq=1, t_mono_ns=0)
        )
        assert writer.foreign == 1
    assert list(counts.levels()) == [
        (FOREIGN, 2, ("robot/state",)),
        (FOREIGN, 0, ("policy/action",)),
    ]


def test_an_episode_without_a_writer_is_refused():
    configure = retarget_runs.configure().model_copy(update={"nodes": {"retarget": "arm"}})
    with pytest.raises(InvalidValue, match="expected also policy, sim"):
        SingleWriter(configure, ForeignCounts(m.RobotState, m.PolicyAction))


@pytest.mark.parametrize("message", [m.EpisodeReady, m.NodeDescription])
def test_what_several_kinds_send_or_none_has_no_single_writer(message):
    with pytest.raises(InvalidValue, match=f"message is '{message.__name__}'"):
        ForeignCounts(message)


def test_faults_are_counted_when_they_are_latched():
    latch = SafetyLatch()
    for fault in (StaleCommand(0.06, 0.05), WrongShape("positions", 7, 6)):
        # The second finds the latch taken.
        latch.engage(fault)
    for _ in range(3):
        latch.engage(EmergencyStopped("sim-0", "button", ""))
    latch.reset()
    latch.engage(StaleCommand(0.06, 0.05))
    assert {each.labels[0]: each.value for each in latch.levels()} == {
        "E-EMERGENCY-STOP": 1,
        "E-STALE-COMMAND": 2,
        "E-SHAPE": 0,
        "E-INVALID-VALUE": 0,
    }
    assert {each.metric for each in latch.levels()} == {FAULTS}


@pytest.mark.parametrize("name", list_robots())
def test_every_robot_begins_within_its_limits(name: str):
    spec = load_robot(name)
    limits = read_limits(spec, read_ranges(spec, compile_robot(spec)))
    assert len(limits.axes) == spec.nv
    guard = Guard(limits, spec.start_positions, latch=SafetyLatch())
    guard.start()
    guard.offer(Setpoint(spec.start_positions, [0.0] * spec.nv), made_s=0.0)
    assert guard.step(0.0).positions == spec.start_positions
    assert not any(vars(guard.counts).values())
    assert all(axis.stop_acceleration >= axis.acceleration for axis in limits.axes) or (
        limits.free_hand
    )
