"""The simulated cell is kept from harm: stops, stale commands, foreign writers. No bus."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path

import pytest

from common import messages as m
from common.clock import TICK_S
from services.sim.reactor import SimReactor
from services.sim.tool_log import ToolLog
from tests.strangers import STRANGER, by_stranger, dropped, strangers_told
from tests.unit.test_sim_reactor import (
    CELL,
    MS,
    START,
    action,
    answers,
    command,
    configure,
    header,
    motor,
    of,
    started,
)

TICK_NS = 10 * MS
SPEED_M_S = 0.25


def stop() -> m.SafetyStop:
    # Whoever presses a button knows no epoch.
    return m.SafetyStop(header=m.Header(cell=CELL), by="button", reason="a hand in the cell")


def reset() -> m.SafetyReset:
    return m.SafetyReset(header=m.Header(cell=CELL), by="button")


def moving(step: int) -> m.RobotCommand:
    """Upwards at an even speed."""
    pose = [*START[:2], START[2] + SPEED_M_S * TICK_S * (step + 1), *START[3:]]
    velocities = [0.0, 0.0, SPEED_M_S, 0.0, 0.0, 0.0]
    return command(step, pose).model_copy(update={"velocities": velocities})


class Cell:
    """A cell in real time whose clock is moved by hand."""

    def __init__(self, log: ToolLog, path: Path) -> None:
        self.reactor = SimReactor(node=CELL, tool_log=log)
        self.log = path
        self.now_ns = 1_000 * MS
        (ready,) = of(m.EpisodeReady, self.reactor.handle([configure(mode="realtime")]))
        assert ready.problem is None
        self.reactor.handle([m.EpisodeStart(header=header())])

    def tick(self, *messages: m.Message) -> list[object]:
        self.now_ns += TICK_NS
        return list(self.reactor.handle([*messages, m.Tick(self.now_ns)]))

    def heights_m(self) -> list[float]:
        with self.log.open(newline="") as file:
            return [float(row["z_m"]) for row in csv.DictReader(file)]

    def lift(self, ticks: int) -> None:
        for step in range(ticks):
            self.tick(moving(step), motor(step))


@pytest.fixture
def cell(tmp_path) -> Iterator[Cell]:
    path = tmp_path / "tool.csv"
    with ToolLog(path) as log:
        yield Cell(log, path)


def test_a_cell_begins_stopped_and_says_so():
    (state,) = SimReactor(node=CELL).handle([m.Tick(5)])
    assert isinstance(state, m.SafetyState)
    assert (state.header.cell, state.status, state.fault) == (CELL, "stopped", None)


def test_in_real_time_the_robot_holds_until_it_is_told_to_move(cell: Cell):
    for _ in range(20):
        messages = cell.tick()
        assert of(m.RobotState, messages)
    assert cell.heights_m()[-1] == pytest.approx(START[2], abs=1e-4)


def test_when_commands_stop_the_robot_comes_to_rest_and_its_episode_is_aborted(cell: Cell):
    cell.lift(40)
    assert cell.heights_m()[-1] - cell.heights_m()[-2] == pytest.approx(
        SPEED_M_S * TICK_S, rel=0.05
    )
    seen = [message for _ in range(10) for message in cell.tick()]
    (result,) = of(m.EpisodeResult, seen)
    assert result.result.outcome == "aborted"
    assert result.result.reason.startswith(
        "robot_fault: arm: the newest joint command is 60 ms old"
    )
    assert "(E-STALE-COMMAND)" in result.result.reason
    first, *_ = [s for s in of(m.SafetyState, seen) if s.fault is not None]
    assert first.fault is not None
    assert (first.fault.code, first.emergency_stop) == ("E-STALE-COMMAND", False)
    # The cause is told before the result.
    assert seen.index(first) < seen.index(result)


def test_after_the_end_the_world_goes_on_and_the_robot_holds(cell: Cell):
    cell.lift(40)
    ended_at = len(cell.heights_m())
    cell.reactor.handle([m.EpisodeAbort(header=header(), reason="the policy died")])
    for _ in range(100):
        assert not of(m.RobotState, cell.tick())
    heights_m = cell.heights_m()
    assert len(heights_m) == ended_at + 100
    assert max(heights_m[ended_at + 30 :]) - min(heights_m[ended_at + 30 :]) < 2e-4


def test_a_new_episode_releases_a_fault_but_no_emergency_stop(cell: Cell):
    cell.lift(5)
    for _ in range(20):
        cell.tick()
    (ready,) = of(m.EpisodeReady, cell.reactor.handle([configure()]))
    assert ready.problem is None
    cell.reactor.handle([stop()])
    (ready,) = of(m.EpisodeReady, cell.reactor.handle([configure()]))
    assert ready.problem is not None
    assert ready.problem.code == "E-EMERGENCY-STOP"
    assert list(cell.reactor.handle([m.EpisodeStart(header=header())])) == []


def test_an_emergency_stop_in_real_time_brakes_and_lasts_until_reset(cell: Cell):
    cell.lift(40)
    seen = list(cell.reactor.handle([stop()]))
    (state,) = of(m.SafetyState, seen)
    assert (state.status, state.emergency_stop) == ("stopping", True)
    (result,) = of(m.EpisodeResult, seen)
    assert result.result.reason.startswith(
        f"emergency_stop: emergency stop of {CELL} by button (a hand in the"
    )
    # Not while it moves.
    assert not of(m.SafetyState, cell.reactor.handle([reset()]))
    states = [s for _ in range(30) for s in of(m.SafetyState, cell.tick())]
    assert (states[-1].status, states[-1].emergency_stop) == ("stopped", True)
    (released,) = of(m.SafetyState, cell.reactor.handle([reset()]))
    assert (released.status, released.fault) == ("stopped", None)
    # It still stands where it stopped.
    at_rest_m = cell.heights_m()[-1]
    for _ in range(20):
        cell.tick()
    assert cell.heights_m()[-1] == pytest.approx(at_rest_m, abs=2e-4)


def test_an_emergency_stop_ends_an_episode_in_lockstep():
    reactor, _ = started()
    reactor.handle(answers(0, due=True))
    seen = list(reactor.handle([stop()]))
    (result,) = of(m.EpisodeResult, seen)
    assert result.result.outcome == "aborted"
    assert "(E-EMERGENCY-STOP)" in result.result.reason
    (state,) = of(m.SafetyState, seen)
    assert (state.status, state.emergency_stop) == ("stopped", True)
    assert list(reactor.handle(answers(1, due=False))) == []


def test_an_emergency_stop_is_taken_when_nothing_runs_and_before_a_start():
    reactor = SimReactor(node=CELL)
    (state,) = reactor.handle([stop()])
    assert isinstance(state, m.SafetyState)
    assert state.emergency_stop
    assert list(reactor.handle([stop()])) == []
    reactor.handle([reset(), configure()])
    reactor.handle([stop()])
    assert list(reactor.handle([m.EpisodeStart(header=header())])) == []


def test_only_the_nodes_of_the_episode_are_listened_to(caplog):
    reactor, _ = started()
    for message in (command(0), command(0), motor(0), action(0)):
        assert list(reactor.handle([by_stranger(message)])) == []
    assert strangers_told(caplog) == [STRANGER]
    assert dropped(reactor) == {
        "robot/command": 2,
        "gripper/motor_command": 1,
        "retarget/status": 0,
        "policy/action": 1,
    }
    (state,) = of(m.SafetyState, reactor.handle([m.Tick(5)]))
    assert state.counts.foreign_messages == 4
    # Its own still complete the tick.
    assert of(m.RobotState, reactor.handle(answers(0, due=True)))


def test_a_leap_is_taken_within_the_limits_and_counted():
    reactor, _ = started(robot="panda")
    seen: list[object] = []
    for step in range(10):
        far = [0.0, 0.5, -0.9, -2.0, 2.6, 1.0, -1.8]
        leap = command(step, far).model_copy(update={"velocities": [0.0] * 7})
        seen += reactor.handle([*answers(step, due=step == 0)[:-2], leap, motor(step)])
    states = of(m.RobotState, seen)
    assert len(states) == 10
    fastest = max(abs(v) for state in states for v in state.velocities)
    assert 0.3 < fastest < 2.61
    (state,) = of(m.SafetyState, reactor.handle([m.Tick(5)]))
    assert state.counts.velocity_clamps == 10
    assert state.counts.position_clamps == 0
