"""The retargeting service without a bus: messages in, messages out."""

import subprocess
import sys

import pytest

from common.errors import UnknownName
from common.messages import EpisodeReady, EpisodeStart, RetargetStatus, RobotCommand
from common.robots import load_robot
from services.retarget.reactor import RetargetReactor
from tests.retarget_runs import CELL, NODE, SIM, abort, action, configure, header, state, step
from tests.strangers import STRANGER, by_stranger, dropped, strangers_told


@pytest.fixture(scope="module")
def reactor_with_models():
    reactor = RetargetReactor(node=NODE, robots=["panda", "abstract"])
    reactor.handle([configure("panda")])
    return reactor


@pytest.fixture
def reactor(reactor_with_models):
    # An abort ends what another test began; loaded models are kept.
    for epoch in range(1, 5):
        reactor_with_models.handle([abort(epoch)])
    return reactor_with_models


def _one(messages):
    (message,) = messages
    return message


def test_configure_is_answered_and_makes_it_serve_the_cell(reactor):
    assert not reactor.serves(CELL)
    ready = _one(reactor.handle([configure()]))
    assert isinstance(ready, EpisodeReady)
    assert (ready.node, ready.kind, ready.problem) == (NODE, "retarget", None)
    assert ready.header.epoch == 1
    assert ready.header.cell == CELL
    assert reactor.serves(CELL)
    assert not reactor.serves("cell-2")
    assert reactor.offers() == {"robots": ["abstract", "panda"]}


def test_an_episode_of_another_node_is_not_served(reactor):
    reactor.handle([configure()])
    assert reactor.handle([configure(node="retarget-2", epoch=2)]) == []
    assert not reactor.serves(CELL)
    assert reactor.handle([state(0, epoch=2)]) == []


def test_a_robot_it_does_not_serve_is_a_problem(reactor):
    ready = _one(reactor.handle([configure("spot")]))
    assert ready.problem is not None
    assert ready.problem.code == "E-UNKNOWN-NAME"
    assert not reactor.serves(CELL)


def test_unknown_robot_at_start_is_refused():
    with pytest.raises(UnknownName):
        RetargetReactor(node=NODE, robots=["pnda"])


@pytest.mark.parametrize("robot", ["panda", "abstract"])
def test_a_state_is_answered_by_status_and_command(reactor, robot):
    reactor.handle([configure(robot)])
    spec = load_robot(robot)
    for tick in range(9):
        (command,) = reactor.handle([state(tick, robot)])
        assert isinstance(command, RobotCommand)
        assert command.for_step == tick
    status, command = reactor.handle([state(9, robot)])
    assert isinstance(status, RetargetStatus)
    assert isinstance(command, RobotCommand)
    for answer in (status, command):
        assert answer.for_step == answer.header.step == 9
        assert answer.request_t_mono_ns == 1000 + 9
        assert (answer.header.cell, answer.header.epoch) == (CELL, 1)
        assert answer.header.episode == "episode-1"
    assert command.positions == pytest.approx(spec.start_positions, abs=1e-9)
    assert command.velocities == pytest.approx([0.0] * spec.nv, abs=1e-7)
    assert status.T_world_reference == pytest.approx([0.1, -0.3, 0.8, 1, 0, 0, 0], abs=1e-6)
    assert status.hand_error_m == pytest.approx([0.0] * 10, abs=1e-9)
    assert status.solver_failures == 0
    assert status.hand_scaling == [1.0] * 10
    assert (status.active_limits, status.limited_ticks) == ([], 0)
    assert len(status.solve_time_s) == 10
    assert min(status.solve_time_s) > 0.0


def test_asked_again_it_repeats_itself_and_older_ticks_are_ignored(reactor):
    reactor.handle([configure()])
    reactor.handle([action(0)])
    first = reactor.handle([state(0, due=0)])
    second = reactor.handle([state(1)])
    assert reactor.handle([state(1)]) == second
    assert reactor.handle([state(1), state(1)]) == [*second, *second]
    assert reactor.handle([state(0, due=0)]) == []
    assert reactor.handle([state(2)])[0].positions != second[0].positions
    assert first != second


def test_a_due_action_is_waited_for(reactor):
    reactor.handle([configure()])
    assert reactor.handle([state(0, due=0)]) == []
    # A resend changes nothing, and neither does an action for a later frame.
    assert reactor.handle([state(0, due=0)]) == []
    assert reactor.handle([action(10, step([0.9, 0, 0]))]) == []
    (command,) = reactor.handle([action(0)])
    assert command.for_step == 0
    assert command.velocities != pytest.approx([0.0] * 7, abs=1e-6)
    assert reactor.handle([state(0, due=0)]) == [command]


def test_an_action_takes_effect_at_its_tick_only(reactor):
    reactor.handle([configure("abstract")])
    reactor.handle([action(0, step([0.1, 0, 0]))])
    for tick in range(5):
        (command,) = reactor.handle([state(tick, "abstract")])
        assert command.positions[0] == pytest.approx(0.1)
    (command,) = reactor.handle([state(5, "abstract", due=0)])
    assert command.positions[0] == pytest.approx(0.11)
    assert command.velocities[:3] == pytest.approx([1.0, 0.0, 0.0])


def test_a_free_hand_turns_about_its_own_axes(reactor):
    reactor.handle([configure("abstract")])
    pose = [0.0, 0.0, 0.0, 2**-0.5, 0.0, 0.0, 2**-0.5]
    reactor.handle([action(0, step([0, 0, 0], [0.5, 0, 0]))])
    (command,) = reactor.handle([state(0, "abstract", due=0, positions=pose)])
    # About the hand's x axis, which is the world's y axis here.
    assert command.velocities == pytest.approx([0, 0, 0, 5.0, 0, 0], abs=1e-12)


def test_in_real_time_an_action_applies_at_the_next_state(reactor):
    reactor.handle([configure("abstract", mode="realtime")])
    (command,) = reactor.handle([state(0, "abstract")])
    assert command.positions[0] == pytest.approx(0.1)
    assert reactor.handle([action(0, step([0.1, 0, 0]))]) == []
    (command,) = reactor.handle([state(3, "abstract")])
    assert command.positions[0] == pytest.approx(0.11)
    # An older action that arrives late is not played back.
    reactor.handle([action(0, step([-0.5, 0, 0]))])
    (command,) = reactor.handle([state(4, "abstract")])
    assert command.positions[0] == pytest.approx(0.12)


def test_in_real_time_two_actions_at_once_both_count(reactor):
    reactor.handle([configure("abstract", mode="realtime")])
    reactor.handle([action(10, step([0, 0.1, 0])), action(0, step([0.1, 0, 0]))])
    (command,) = reactor.handle([state(0, "abstract")])
    assert command.positions[:3] == pytest.approx([0.11, -0.29, 0.8])


def test_in_real_time_a_chunk_ends_soon_after_the_policy_fell_silent(reactor):
    reactor.handle([configure("abstract", mode="realtime")])
    reactor.handle([state(0, "abstract"), action(0, *[step([0.03, 0, 0])] * 64)])
    xs = []
    for tick in range(1, 60):
        (*_, command) = reactor.handle([state(tick, "abstract")])
        xs.append(command.positions[0])
    assert xs[12] - xs[11] == pytest.approx(0.003)
    assert xs[14:] == [xs[14]] * len(xs[14:])
    # The next action leads on from there.
    reactor.handle([action(60, step([0.03, 0, 0]))])
    (*_, command) = reactor.handle([state(60, "abstract")])
    assert command.positions[0] > xs[-1]


def test_in_lockstep_a_chunk_runs_to_its_end(reactor):
    reactor.handle([configure("abstract"), action(0, *[step([0.03, 0, 0])] * 4)])
    for tick in range(60):
        (*_, command) = reactor.handle([state(tick, "abstract", due=-1 if tick else 0)])
    assert command.positions[0] == pytest.approx(0.1 + 4 * 0.03)


def test_wrong_shape_is_logged_once_and_ignored(reactor, caplog):
    reactor.handle([configure()])
    assert reactor.handle([state(0, "abstract"), state(1, positions=[0.0] * 6)]) == []
    records = [record for record in caplog.records if getattr(record, "code", "") == "E-SHAPE"]
    assert len(records) == 1
    assert "expected 7" in records[0].expected or "expected 6" in records[0].expected
    assert len(reactor.handle([state(2)])) == 1


@pytest.mark.parametrize("mode", ["lockstep", "realtime"])
def test_states_and_actions_of_strangers_move_nothing_and_get_no_answer(mode, caplog):
    reactor = RetargetReactor(node=NODE, robots=["abstract"])
    reactor.handle([configure("abstract", mode=mode)])
    pushed, first = action(0, step([0.5, 0, 0])), state(0, "abstract", due=0)
    assert reactor.handle([by_stranger(pushed), by_stranger(first)]) == []
    (command,) = reactor.handle([action(0, step([0.1, 0, 0])), first])
    assert command.positions[0] == pytest.approx(0.11)
    # Neither what is due later nor what is repeated from memory.
    later = action(10, step([0.5, 0, 0]))
    assert reactor.handle([by_stranger(later), by_stranger(first)]) == []
    (command,) = reactor.handle([state(1, "abstract")])
    assert command.positions[0] == pytest.approx(0.12)
    assert dropped(reactor) == {"robot/state": 2, "policy/action": 2}
    assert strangers_told(caplog) == [STRANGER]


def test_an_episode_that_names_no_policy_is_a_problem(reactor):
    nodes = {"sim": SIM, "retarget": NODE}
    ready = _one(reactor.handle([configure().model_copy(update={"nodes": nodes})]))
    assert ready.problem is not None
    assert ready.problem.expected == "expected also policy"
    assert not reactor.serves(CELL)


def test_abort_ends_the_episode(reactor):
    reactor.handle([configure()])
    assert reactor.handle([abort(), state(0)]) == []
    assert not reactor.serves(CELL)


def test_configure_again_repeats_the_answer_and_keeps_the_episode(reactor):
    first = reactor.handle([configure()])
    answer = reactor.handle([state(0)])
    assert reactor.handle([configure()]) == first
    assert reactor.handle([state(0)]) == answer


def test_a_new_epoch_starts_over_bit_for_bit(reactor):
    def play(epoch):
        reactor.handle([configure(epoch=epoch)])
        commands = []
        for tick in range(40):
            due = tick if tick % 10 == 0 else -1
            if due >= 0:
                turned = step([0.03, 0.02, -0.01], [0.1, -0.2, 0.3])
                reactor.handle([action(due, turned, epoch=epoch)])
            commands.append(reactor.handle([state(tick, due=due, epoch=epoch)])[-1].positions)
        return commands

    first = play(1)
    assert reactor.handle([state(40, epoch=2)]) == []
    assert play(2) == first
    assert first[0] != first[-1]


def test_episodes_start_at_the_measured_state(reactor):
    reactor.handle([configure()])
    moved = [value + 0.05 for value in load_robot("panda").start_positions]
    (command,) = reactor.handle([state(0, positions=moved)])
    # At rest: only the posture moves, within the acceleration limits.
    assert command.positions == pytest.approx(moved, abs=0.01 * 0.2)


def test_hand_error_is_measured_against_the_measured_pose(reactor):
    reactor.handle([configure("abstract")])
    away = [0.1, -0.3, 0.83, 1.0, 0.0, 0.0, 0.0]
    for tick in range(9):
        reactor.handle([state(tick, "abstract")])
    status, _ = reactor.handle([state(9, "abstract", positions=away)])
    assert status.hand_error_m == pytest.approx([0.0] * 9 + [0.03])
    assert status.T_world_tool == pytest.approx(away)


def test_status_tells_what_held_the_hand_back(reactor):
    reactor.handle([configure(), action(0, step([0.05, 0, 0]))])
    for tick in range(9):
        reactor.handle([state(tick, due=-1 if tick else 0)])
    status, _ = reactor.handle([state(9)])
    assert len(status.hand_scaling) == 10
    assert min(status.hand_scaling) == status.scaling[0] < 1.0
    # From rest it can only set off as fast as its accelerations allow.
    assert status.hand_scaling[0] < 1.0
    assert status.active_limits
    assert 0 < status.limited_ticks <= 10


def test_the_start_message_is_not_needed(reactor):
    assert EpisodeStart not in reactor.inputs
    reactor.handle([configure()])
    assert reactor.handle([EpisodeStart(header=header())]) == []
    assert len(reactor.handle([state(0)])) == 1


def test_command_line_says_what_is_wrong():
    done = subprocess.run(
        [sys.executable, "-m", "services.retarget", "--robot", "pnda"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert "E-UNKNOWN-NAME" in done.stderr
    assert "did you mean: panda" in done.stderr
    assert "Traceback" not in done.stderr
