"""Bad input is refused where it arrives, with one clear error, and moves no robot."""

from __future__ import annotations

import math
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest

from common import messages as m
from common.bus import Bus, BusSettings, Inbox, decode, open_session
from common.bus.codec import encode, encoding_of
from common.errors import BadRobotFile, InvalidValue, MalformedMessage, WrongShape
from common.messages.base import has_unit_quaternion
from common.robots import load_robot
from common.robots.compile import compile_robot
from common.robots.loader import ROBOTS_FOLDER
from common.service import Host
from common.topics import key_of, topic_of
from services.retarget.bounds import JointBounds, JointLimits
from services.retarget.reactor import RetargetReactor
from services.retarget.reference import WaypointInterpolator
from tests.retarget_runs import CELL, NODE, action, configure, header, make_panda, rest, state, step
from tests.strangers import STRANGER, by_stranger, dropped, strangers_told

NAN, HUGE = math.nan, 1e300

Spoil = Callable[[dict[str, Any]], None]


def spoiled(message: m.Message, spoil: Spoil) -> bytes:
    """The bytes of a message with something in it that no sender could build."""
    fields = msgpack.unpackb(encode(message))
    spoil(fields)
    return msgpack.packb(fields)


def put(field: str, index: int, value: float) -> Spoil:
    return lambda fields: fields[field].__setitem__(index, value)


def put_step(field: str, value: list[float]) -> Spoil:
    return lambda fields: fields["steps"][0].__setitem__(field, value)


def truth() -> m.GroundTruth:
    pose = [0.5, 0.0, 0.7, 1.0, 0.0, 0.0, 0.0]
    return m.GroundTruth(header=header(), T_world_tool=pose, objects={"lid": pose}, opening_m=0.0)


def put_lid(quaternion: list[float]) -> Spoil:
    return lambda fields: fields["objects"]["lid"].__setitem__(slice(3, 7), quaternion)


@pytest.mark.parametrize(
    ("message", "spoil", "problem"),
    [
        (state(0), put("positions", 2, NAN), "positions.2: Input should be a finite number"),
        (state(0), put("velocities", 0, math.inf), "velocities.0: Input should be a finite"),
        (state(0), put("positions", 2, 1e4), "positions.2: .* less than or equal to 1000"),
        (state(0), put("velocities", 6, -HUGE), "velocities.6: .* greater than or equal to -1000"),
        (action(0), put_step("translation_m", [0, NAN, 0]), "translation_m.1: .* finite number"),
        (action(0), put_step("rotation_rad", [NAN, 0, 0]), "rotation_rad.0: .* finite number"),
        (action(0), put_step("translation_m", [0.0, 10.0, 0.0]), "length 10, expected at most 1"),
        (action(0), put_step("rotation_rad", [6.0, 8.0, 0.0]), "length 10, expected at most 3.14"),
        (truth(), put_lid([0.0] * 4), "objects.lid: .* length 0, expected 1"),
        (truth(), put_lid([1.0, 1.0, 0.0, 0.0]), "objects.lid: .* length 1.414"),
        (truth(), put("T_world_tool", 3, 0.5), "T_world_tool: .* length 0.5, expected 1"),
        (truth(), put("T_world_tool", 3, NAN), "T_world_tool.3: .* finite number"),
    ],
)
def test_garbage_is_refused_on_the_way_in(message: m.Message, spoil: Spoil, problem: str):
    topic, encoding = topic_of(type(message)), encoding_of(type(message))
    assert decode(topic, encoding, encode(message)) == message
    with pytest.raises(MalformedMessage, match=problem) as caught:
        decode(topic, encoding, spoiled(message, spoil))
    assert caught.value.topic == topic.name


def test_the_longest_step_is_one_metre_and_half_a_turn():
    assert step([0.6, 0.0, 0.8], [0.0, 0.0, math.pi]).translation_m == [0.6, 0.0, 0.8]


@pytest.mark.parametrize(
    ("quaternion", "is_unit"),
    [
        ([1.0, 0.0, 0.0, 0.0], True),
        ([0.5, -0.5, 0.5, -0.5], True),
        ([0.9995, 0.0, 0.0, 0.0], True),
        ([0.99, 0.0, 0.0, 0.0], False),
        ([0.0, 0.0, 0.0, 0.0], False),
        ([NAN, 0.0, 0.0, 0.0], False),
    ],
)
def test_a_quaternion_is_normalised_or_is_none(quaternion: list[float], is_unit: bool):
    assert has_unit_quaternion([0.0, 0.0, 0.0, *quaternion]) is is_unit


class Wire:
    """A retargeter on a bus: bytes in, commands out."""

    def __init__(self, bus: Bus, session: Any, robot: str) -> None:
        self._session = session
        self.host = Host(RetargetReactor(node=NODE, robots=[robot]), bus, node=NODE)
        self._commands = Inbox()
        bus.subscribe(topic_of(m.RobotCommand), self._commands)
        self.host.start()
        self.send(configure(robot))

    def send(self, message: m.Message, spoil: Spoil = lambda _: None) -> list[m.Message]:
        """Put a message on the bus; what the robot is told then."""
        key, encoding = key_of(topic_of(type(message)), CELL), encoding_of(type(message))
        self._session.put(key, spoiled(message, spoil), encoding=encoding)
        while self.host.spin():
            pass
        received = self._commands.drain()[1]
        return [decode(each.topic, each.encoding, each.payload) for each in received]


@pytest.fixture
def wire() -> Iterator[Callable[[str], Wire]]:
    with (
        open_session(BusSettings("in_process", namespace="bad")) as session,
        Bus(session) as bus,
    ):
        yield lambda robot: Wire(bus, session, robot)


def complaints(caplog: pytest.LogCaptureFixture, code: str) -> list[Any]:
    return [record for record in caplog.records if getattr(record, "code", "") == code]


def test_garbage_is_counted_logged_once_and_moves_nothing(wire, caplog):
    panda = wire("panda")
    assert panda.send(state(0), put("positions", 0, NAN)) == []
    assert panda.send(state(0), put("positions", 0, HUGE)) == []
    assert panda.host.metrics().rejected == 2
    (record,) = complaints(caplog, "E-MALFORMED")
    assert record.happened == "robot/state: positions.0: Input should be a finite number"
    (command,) = panda.send(state(0))
    assert isinstance(command, m.RobotCommand)
    assert command.for_step == 0


def test_a_tick_waits_for_its_action_when_the_one_that_came_was_garbage(wire, caplog):
    panda = wire("panda")
    assert panda.send(state(0, due=0)) == []
    for _ in range(3):
        assert panda.send(action(0), put_step("translation_m", [10.0, 0.0, 0.0])) == []
    assert panda.host.metrics().rejected == 3
    assert len(complaints(caplog, "E-MALFORMED")) == 1
    (command,) = panda.send(action(0))
    assert isinstance(command, m.RobotCommand)
    assert max(map(abs, command.velocities)) < 1.0


def test_a_strangers_action_on_the_bus_is_not_the_one_that_a_tick_waits_for(wire, caplog):
    panda = wire("panda")
    assert panda.send(state(0, due=0)) == []
    for _ in range(3):
        assert panda.send(by_stranger(action(0, step([0.5, 0, 0])))) == []
    assert dropped(panda.host.reactor) == {"robot/state": 0, "policy/action": 3}
    assert strangers_told(caplog) == [STRANGER]
    (command,) = panda.send(action(0, step()))
    assert isinstance(command, m.RobotCommand)
    assert command.positions == pytest.approx(load_robot("panda").start_positions, abs=1e-9)


@pytest.mark.parametrize("mode", ["lockstep", "realtime"])
@pytest.mark.parametrize("quaternion", [[0.0] * 4, [2.0, 0.0, 0.0, 0.0], [0.5, 0.5, 0.5, 0.4]])
def test_a_hand_without_a_rotation_is_ignored_and_logged_once(mode, quaternion, caplog):
    reactor = RetargetReactor(node=NODE, robots=["abstract"])
    reactor.handle([configure("abstract", mode=mode)])
    bad = [0.1, -0.3, 0.8, *quaternion]
    # At the start, where the reference would begin, and later.
    assert reactor.handle([state(0, "abstract", positions=bad)]) == []
    (first,) = reactor.handle([state(0, "abstract")])
    assert reactor.handle([state(1, "abstract", positions=bad)]) == []
    (second,) = reactor.handle([state(1, "abstract")])
    assert second.positions == first.positions == load_robot("abstract").start_positions
    (record,) = complaints(caplog, "E-INVALID-VALUE")
    assert str(quaternion) in record.happened
    assert record.expected == "expected length 1"


@pytest.mark.parametrize("robot", ["panda", "abstract"])
def test_a_state_of_another_length_moves_nothing(robot, caplog):
    reactor = RetargetReactor(node=NODE, robots=[robot])
    reactor.handle([configure(robot)])
    assert reactor.handle([state(0, robot, positions=[0.0] * 12)]) == []
    assert [record.happened for record in complaints(caplog, "E-SHAPE")] == [
        "RobotState.positions has 12 values"
    ]
    assert len(reactor.handle([state(0, robot)])) == 1


@pytest.mark.parametrize(
    ("change", "suggestion"), [({"task": "lidd"}, "lid"), ({"robot": "pnada"}, "panda")]
)
def test_an_episode_of_an_unknown_task_or_robot_is_answered_by_the_problem(change, suggestion):
    reactor = RetargetReactor(node=NODE, robots=["panda"])
    (ready,) = reactor.handle([configure().model_copy(update=change)])
    assert isinstance(ready, m.EpisodeReady)
    assert ready.problem is not None
    assert ready.problem.code == "E-UNKNOWN-NAME"
    assert ready.problem.action == f"did you mean: {suggestion}"
    assert not reactor.serves(CELL)
    assert reactor.handle([state(0), action(0)]) == []


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    shutil.copytree(ROBOTS_FOLDER / "panda", tmp_path / "panda")
    return tmp_path


def replace(folder: Path, pattern: str, replacement: str) -> None:
    path = folder / "panda" / "robot.toml"
    text, count = re.subn(pattern, replacement, path.read_text(), count=1)
    assert count == 1
    path.write_text(text)


@pytest.mark.parametrize(
    ("pattern", "replacement", "element", "problem"),
    [
        ("velocity_limit = .*", "", "joints.0.velocity_limit", "Field required (of joint1)"),
        ("acceleration_limit = .*", "", "joints.0.acceleration_limit", "Field required"),
        ("torque_limit = .*", "", "joints.0.torque_limit", "Field required"),
        ("bias = .*", "", "joints.0.bias", "Field required"),
        ("velocity_limit = .*", "velocity_limit = -1.0", "joints.0.velocity_limit", "than 0"),
        ("velocity_limit = .*", "velocity_limit = nan", "joints.0.velocity_limit", "finite"),
        ("acceleration_limit = .*", "acceleration_limit = inf", "joints.0.acc", "finite"),
        ("start = .*", "start = nan", "joints.0.start", "finite"),
        ("kind = .*", 'kind = "legs"', "kind", "'free_hand' or 'joints'"),
        (
            "kind = .*",
            'kind = "joints"\nT_world_start = [0.1, -0.3, 0.8, 1.0, 1.0, 0.0, 0.0]',
            "T_world_start",
            "length 1.41421, expected 1",
        ),
        ("kind = .*", 'kind = "joints"\ncommand_latency_s = -0.1', "command_latency_s", "to 0"),
        (
            r"\Z",
            '[[walls]]\nname = "w"\npoint = [0, 0, 0]\nnormal = [0, 0, 2]\n',
            "walls.0",
            "length 2, expected 1",
        ),
    ],
)
def test_robot_toml_is_refused_by_the_loader(folder, pattern, replacement, element, problem):
    replace(folder, pattern, replacement)
    with pytest.raises(BadRobotFile) as caught:
        load_robot("panda", folder=folder)
    assert caught.value.element.startswith(element)
    assert problem in caught.value.problem


@pytest.mark.parametrize(
    ("pattern", "replacement", "element", "problem"),
    [
        ("bias = .*", "bias = 3.0", "joint joint1", "bias 3 is outside the range"),
        ("kind = .*", 'kind = "joints"\ntool_site = "hook"', "site hook", "is missing in model"),
        (r"\Z", '[head]\nsite = "eyes"\n', "site eyes", "is missing in model.xml"),
        (
            r"\Z",
            '[[walls]]\nname = "w"\nsite = "elbow"\npoint = [0, 0, 0]\nnormal = [0, 0, 1]\n',
            "site elbow",
            "is missing in model.xml",
        ),
    ],
)
def test_a_robot_that_contradicts_its_model_is_a_problem_of_the_episode(
    folder, monkeypatch, pattern, replacement, element, problem
):
    replace(folder, pattern, replacement)
    spec = load_robot("panda", folder=folder)
    with pytest.raises(BadRobotFile) as caught:
        compile_robot(spec)
    assert caught.value.element == element
    monkeypatch.setattr("services.retarget.reactor.load_robot", lambda _: spec)
    reactor = RetargetReactor(node=NODE, robots=["panda"])
    (ready,) = reactor.handle([configure()])
    assert isinstance(ready, m.EpisodeReady)
    assert ready.problem is not None
    assert ready.problem.code == "E-ROBOT-FILE"
    assert f"{element}: " in ready.problem.happened
    assert problem in ready.problem.happened
    assert reactor.handle([state(0)]) == []


@pytest.mark.parametrize("dt_s", [0.0, -0.01, NAN])
def test_a_tick_takes_time(dt_s: float):
    with pytest.raises(InvalidValue, match="dt_s"):
        JointBounds([JointLimits(-1.0, 1.0, 1.0, 1.0)], dt_s=dt_s)


def test_a_start_has_one_finite_position_per_joint():
    panda = make_panda()
    with pytest.raises(WrongShape, match="start positions has 6 values"):
        panda.start([0.0] * 6)
    with pytest.raises(InvalidValue, match="start positions"):
        panda.start([0.0] * 6 + [NAN])
    # It goes on from where it was.
    assert max(map(abs, panda.follow(rest(panda.T_world_hand)).velocities)) < 1e-3


def test_a_waypoint_is_finite():
    interpolator = WaypointInterpolator(np.eye(4))
    bad = np.eye(4)
    bad[0, 3] = NAN
    with pytest.raises(InvalidValue, match="waypoint"):
        interpolator.aim(bad)
    assert np.array_equal(interpolator.advance().T_world_end, np.eye(4))
