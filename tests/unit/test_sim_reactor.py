"""The simulation as a reactor: messages in, messages out, no bus."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeVar

import pytest

from common import messages as m
from common.calibration.four_bar import OPEN_RAD
from common.clock import FRAME_TICKS
from common.robots import RobotSpec, load_robot
from services.sim.reactor import SimReactor

CELL = "sim-0"
MS = 1_000_000
START = [0.1, -0.3, 0.8, 1.0, 0.0, 0.0, 0.0]

Kind = TypeVar("Kind")


def header(step: int = 0, source: str = "") -> m.Header:
    return m.Header(cell=CELL, episode="e", epoch=1, step=step, source=source)


def configure(**changes: object) -> m.EpisodeConfigure:
    fields: dict[str, object] = {
        "header": header(),
        "task": "lid",
        "robot": "abstract",
        "policy": "expert",
        "seed": 5,
        "mode": "lockstep",
        "nodes": {"sim": CELL, "retarget": "arm", "gripper": "hand", "policy": "brain"},
    }
    return m.EpisodeConfigure.model_validate(fields | changes)


def of(kind: type[Kind], messages: Iterable[object]) -> list[Kind]:
    return [message for message in messages if isinstance(message, kind)]


def started(**changes: object) -> tuple[SimReactor, list[object]]:
    reactor = SimReactor(node=CELL)
    (ready,) = reactor.handle([configure(**changes)])
    assert isinstance(ready, m.EpisodeReady)
    assert ready.problem is None
    return reactor, list(reactor.handle([m.EpisodeStart(header=header())]))


def command(step: int, positions: list[float] | None = None, t_ns: int = 0) -> m.RobotCommand:
    return m.RobotCommand(
        header=header(step, "arm"),
        for_step=step,
        request_t_mono_ns=t_ns,
        positions=positions or START,
        velocities=[0.0] * 6,
    )


def status(step: int) -> m.RetargetStatus:
    return m.RetargetStatus(
        header=header(step, "arm"),
        for_step=step,
        request_t_mono_ns=0,
        T_world_reference=START,
        T_world_tool=START,
        hand_error_m=[0.001] * FRAME_TICKS,
        hand_error_rad=[0.0] * FRAME_TICKS,
        solve_time_s=[1e-4] * FRAME_TICKS,
        hand_scaling=[0.5] + [1.0] * (FRAME_TICKS - 1),
        scaling=[0.5],
        active_limits=["joint1"],
        limited_ticks=2,
        solver_failures=0,
    )


def motor(step: int) -> m.MotorCommand:
    return m.MotorCommand(
        header=header(step, "hand"),
        for_step=step,
        request_t_mono_ns=0,
        positions_rad=[OPEN_RAD] * 2,
        current_limit_a=0.6,
    )


def action(for_step: int, *, grasp: bool = False) -> m.PolicyAction:
    step = m.ActionStep(translation_m=[0.0] * 3, rotation_rad=[0.0] * 3, grasp=grasp)
    return m.PolicyAction(
        header=header(for_step, "brain"),
        for_step=for_step,
        request_t_mono_ns=0,
        steps=[step],
        inference_s=0.001,
    )


def answers(step: int, *, due: bool) -> list[m.Message]:
    end = [status(step)] if (step + 1) % FRAME_TICKS == 0 else []
    return [*([action(step)] if due else []), *end, command(step), motor(step)]


def test_an_episode_opens_with_frame_truth_and_states():
    _, messages = started()
    assert [type(x) for x in messages] == [
        m.SafetyState,
        m.EpisodeEvent,
        m.StereoFrame,
        m.GroundTruth,
        m.RobotState,
        m.MotorState,
    ]
    (frame,), (state,) = of(m.StereoFrame, messages), of(m.RobotState, messages)
    assert (frame.width, frame.height, frame.due_step) == (128, 128, 0)
    assert state.due_frame_step == 0
    assert state.positions == pytest.approx(START, abs=1e-4)
    (truth,) = of(m.GroundTruth, messages)
    assert set(truth.objects) == {"stove", "pot", "lid"}


@pytest.mark.parametrize(
    ("wrong", "code"),
    [
        ({"task": "lidd"}, "E-UNKNOWN-NAME"),
        ({"robot": "pnda"}, "E-UNKNOWN-NAME"),
        ({"camera": "t256"}, "E-UNKNOWN-NAME"),
        ({"nodes": {"sim": CELL, "gripper": "hand"}}, "E-INVALID-VALUE"),
    ],
)
def test_what_it_cannot_prepare_is_a_problem(wrong: dict[str, object], code: str):
    reactor = SimReactor(node=CELL)
    (ready,) = reactor.handle([configure(**wrong)])
    assert isinstance(ready, m.EpisodeReady)
    assert ready.problem is not None
    assert ready.problem.code == code
    assert list(reactor.handle([m.EpisodeStart(header=header())])) == []


def test_a_tick_is_taken_when_every_answer_is_there_in_any_order():
    reactor, _ = started()
    for answer in (motor(0), action(0)):
        assert list(reactor.handle([answer])) == []
    messages = list(reactor.handle([command(0)]))
    assert [type(x) for x in messages] == [m.RobotState, m.MotorState]
    assert messages[0].header.step == 1
    # An answer for a tick that is over changes nothing.
    assert list(reactor.handle([command(0), motor(0), action(0)])) == []


def test_frames_and_status_come_every_tenth_tick():
    reactor, messages = started()
    frames = of(m.StereoFrame, messages)
    for step in range(20):
        due = step % FRAME_TICKS == 0
        messages = list(reactor.handle(answers(step, due=due)))
        frames += of(m.StereoFrame, messages)
        if (step + 1) % FRAME_TICKS == 0:
            assert len(of(m.StereoFrame, messages)) == 1
    assert [frame.header.step for frame in frames] == [0, 10, 20]
    assert list(reactor.handle([command(20), motor(20)])) == []


def test_latency_moves_the_tick_at_which_an_action_is_due():
    reactor, messages = started(action_latency_s=0.05)
    (frame,) = of(m.StereoFrame, messages)
    assert frame.due_step == 5
    due = {0: of(m.RobotState, messages)[0].due_frame_step}
    reactor.handle([action(0)])
    for step in range(16):
        for state in of(m.RobotState, reactor.handle(answers(step, due=False))):
            due[state.header.step] = state.due_frame_step
        if step == 10:
            reactor.handle([action(10)])
    assert {step: frame for step, frame in due.items() if frame >= 0} == {5: 0, 15: 10}


def test_silence_is_asked_again_and_then_ends_the_episode_naming_who_is_silent():
    reactor, messages = started()
    reactor.handle([motor(0), action(0)])
    asked = [type(x) for x in messages if not isinstance(x, (m.EpisodeEvent, m.SafetyState))]
    seen: dict[int, list[object]] = {}
    for t in range(0, 1700, 100):
        seen[t] = list(reactor.handle([m.Tick(t * MS)]))
        if of(m.EpisodeResult, seen[t]):
            break
    reports = {t for t, x in seen.items() if of(m.SafetyState, x)}
    assert reports == {0, 1000, 1600}
    assert [t for t, x in seen.items() if x and t not in reports - {1600}] == [400, 800, 1200, 1600]
    assert [type(x) for x in seen[400]] == asked
    (result,) = of(m.EpisodeResult, seen[1600])
    assert result.result.outcome == "aborted"
    assert "arm" in result.result.reason
    assert "hand" not in result.result.reason
    assert result.result.resends == 3


def test_a_command_that_does_not_fit_the_robot_aborts_and_does_not_crash():
    reactor, _ = started()
    messages = list(reactor.handle([action(0), motor(0), command(0, positions=[0.0] * 3)]))
    (result,) = of(m.EpisodeResult, messages)
    assert result.result.outcome == "aborted"
    assert "arm: positions has 3 values" in result.result.reason
    assert "(E-SHAPE)" in result.result.reason


def test_a_commanded_pose_without_a_rotation_aborts_and_does_not_crash():
    reactor, _ = started()
    nowhere = [*START[:3], 0.0, 0.0, 0.0, 0.0]
    messages = list(reactor.handle([action(0), motor(0), command(0, nowhere)]))
    (result,) = of(m.EpisodeResult, messages)
    assert result.result.outcome == "aborted"
    assert "arm: RobotCommand quaternion is [0.0, 0.0, 0.0, 0.0]" in result.result.reason


@pytest.fixture
def short_legged_spot(monkeypatch) -> RobotSpec:
    """A Spot one of whose feet stands too far away once the body is raised."""
    spot = load_robot("spot")
    first, *others = spot.legs
    x, y, z = first.foothold
    far = first.model_copy(update={"foothold": (x + 0.4, y, z)})
    spec = spot.model_copy(update={"legs": (far, *others)})
    monkeypatch.setattr("services.sim.reactor.load_robot", lambda _: spec)
    return spec


def test_a_foothold_out_of_reach_aborts_with_its_reason_and_the_cell_goes_on(short_legged_spot):
    reactor, _ = started(robot="spot")
    raised = list(short_legged_spot.start_positions)
    raised[2] = 0.5
    messages: list[object] = []
    for step in range(60):
        raise_body = command(step, raised).model_copy(update={"velocities": [0.0] * 12})
        due = [action(step)] if step % FRAME_TICKS == 0 else []
        end = [status(step)] if (step + 1) % FRAME_TICKS == 0 else []
        messages = list(reactor.handle([*due, *end, raise_body, motor(step)]))
        if of(m.EpisodeResult, messages):
            break
    assert [event.event for event in of(m.EpisodeEvent, messages)] == ["aborted"]
    (result,) = of(m.EpisodeResult, messages)
    assert result.result.outcome == "aborted"
    assert result.result.reason.startswith(
        f"node_problem: {CELL}: leg fl cannot reach its foothold at"
    )
    assert "(E-FOOTHOLD)" in result.result.reason
    (ready,) = reactor.handle([configure(robot="spot")])
    assert isinstance(ready, m.EpisodeReady)
    assert ready.problem is None


def test_a_state_that_no_message_may_carry_ends_the_episode_as_diverged(monkeypatch):
    reactor, _ = started()

    def explode(self, ticks_s):
        self.data.qvel[:] = 1e5

    monkeypatch.setattr("services.sim.world.World.advance", explode)
    messages = list(reactor.handle(answers(0, due=True)))
    (result,) = of(m.EpisodeResult, messages)
    assert (result.result.outcome, result.result.reason) == ("failure", "the simulation diverged")


def test_abort_stops_at_once_and_sends_no_result():
    reactor, _ = started()
    (state,) = reactor.handle([m.EpisodeAbort(header=header(), reason="test")])
    assert isinstance(state, m.SafetyState)
    assert (state.status, state.fault) == ("stopped", None)
    assert list(reactor.handle(answers(0, due=True))) == []


def test_an_episode_without_motion_fails_at_the_time_limit_and_says_why():
    reactor, _ = started(pictures=True)
    for step in range(4000):
        messages = list(reactor.handle(answers(step, due=step % FRAME_TICKS == 0)))
        if of(m.EpisodeResult, messages):
            break
    (result,) = of(m.EpisodeResult, messages)
    assert result.result.outcome == "failure"
    assert result.result.reason == "time limit of 40 s"
    assert "lid within 12 mm of the pot axis" in result.result.failed_conditions
    assert result.result.stages.names == []
    assert result.result.ticks == 4000
    assert result.result.hand_error_m.median == 0.001
    assert result.result.hand_scaling_mean == pytest.approx(0.95)
    assert result.result.hand_scaling_least == 0.5
    assert result.result.limited_share == pytest.approx(0.2)
    assert result.result.solver_failures == 0
    assert result.result.solve_time_s.p99 == 1e-4
    # Pictures come before the result: with it the cell is free for its next epoch.
    pictures = of(m.EpisodePicture, messages)
    assert [p.moment for p in pictures] == ["start"] * 3 + ["end"] * 3
    assert [p.view for p in pictures] == ["scene", "left", "right"] * 2
    assert messages[-1] is result


def test_an_aborted_episode_draws_nothing():
    reactor, _ = started(pictures=True, node_deadline_s=0.5)
    reactor.handle([m.Tick(0)])
    messages = list(reactor.handle([m.Tick(600 * MS)]))
    assert of(m.EpisodeResult, messages)
    assert not of(m.EpisodePicture, messages)


def first_frame(**changes: object) -> m.StereoFrame:
    _, messages = started(**changes)
    return of(m.StereoFrame, messages)[0]


def test_a_randomised_camera_changes_the_pictures_by_the_seed_alone():
    clean, changed = first_frame(), first_frame(randomise_camera=True)
    assert changed.left != clean.left
    assert changed.right != clean.right
    assert first_frame(randomise_camera=True).left == changed.left
