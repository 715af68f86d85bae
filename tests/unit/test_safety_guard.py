"""The guard between commands and servos, without a robot."""

from __future__ import annotations

import itertools

import pytest

from common import messages as m
from common.clock import TICK_S
from common.errors import EmergencyStopped, InvalidValue, StaleCommand, WrongShape
from common.robots import list_robots, load_robot
from common.robots.compile import compile_robot, read_ranges
from common.safety import Guard, RobotLimits, SafetyLatch, Setpoint, SingleWriter, read_limits
from common.safety.limits import AxisLimits

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
    writer = SingleWriter("sim-0", {m.EpisodeStart: "control"})
    of = {source: m.EpisodeStart(header=m.Header(source=source)) for source in ("control", "x")}
    assert writer.accepts(of["control"])
    assert not writer.accepts(of["x"])
    assert not writer.accepts(of["x"])
    assert writer.foreign == 2
    assert len(caplog.records) == 1


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
