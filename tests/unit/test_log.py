"""Logs: one JSON object per line, bound to what it is about."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterable, Iterator, Sequence

import pytest

from common import messages as m
from common.bus import Bus, BusSettings, open_session
from common.bus.codec import encoding_of
from common.errors import InvalidValue
from common.log import JsonFormatter, about
from common.service import AnyMessage, Host, Reactor
from common.topics import key_of, topic_of

EPISODE = {"cell": "sim-0", "epoch": 7, "evaluation": "e-1", "trial": 12, "attempt": 2}
HEADER = m.Header(cell="sim-0", epoch=7, episode="e-1.12.2")


class Hand(Reactor):
    """Takes part in every episode that names a gripper; refuses those for the cup."""

    kind = "gripper"
    inputs = (m.EpisodeConfigure, m.EpisodeAbort, m.RobotState)

    def __init__(self) -> None:
        self.cells: set[str] = set()

    def serves(self, cell: str) -> bool:
        return cell in self.cells

    def handle(self, messages: Sequence[AnyMessage]) -> Iterable[AnyMessage]:
        for message in messages:
            if isinstance(message, m.EpisodeAbort):
                self.cells.discard(message.header.cell)
            elif isinstance(message, m.EpisodeConfigure) and message.nodes:
                yield self._prepare(message)

    def _prepare(self, configure: m.EpisodeConfigure) -> m.EpisodeReady:
        problem = None
        if configure.task == "cup":
            problem = m.Problem(**InvalidValue("task", "cup", "lid").describe())
        else:
            self.cells.add(configure.header.cell)
        return m.EpisodeReady(header=configure.header, node="hand", kind="gripper", problem=problem)


@pytest.fixture
def host() -> Iterator[Host]:
    with open_session(BusSettings("in_process")) as session, Bus(session) as bus:
        host = Host(Hand(), bus, node="hand")
        host.start()
        yield host


@pytest.fixture
def log(caplog) -> pytest.LogCaptureFixture:
    caplog.set_level(logging.INFO)
    return caplog


def configure(**changes: object) -> m.EpisodeConfigure:
    fields: dict[str, object] = {
        "header": HEADER,
        "task": "lid",
        "robot": "panda",
        "policy": "expert",
        "seed": 3,
        "mode": "lockstep",
        "nodes": {"gripper": "hand"},
    }
    return m.EpisodeConfigure.model_validate(fields | changes)


def give(host: Host, message: m.Message) -> None:
    host.inbox.put_event(message)
    host.spin()


def lines(log: pytest.LogCaptureFixture) -> list[dict[str, object]]:
    """What was logged, as it stands in the log of a process."""
    formatter = JsonFormatter("hand")
    return [json.loads(formatter.format(record)) for record in log.records]


def test_a_line_says_which_episode_it_is_about():
    assert about(HEADER) == EPISODE


@pytest.mark.parametrize("episode", ["", "demo", "e-1.x.2", "a.1"])
def test_an_episode_of_another_form_stays_in_one_piece(episode):
    header = m.Header(cell="c", epoch=1, episode=episode)
    assert about(header) == {"cell": "c", "epoch": 1, "episode": episode}


def test_an_evaluation_may_have_dots_in_its_name():
    assert about(m.Header(episode="e.2.1.3.4"))["evaluation"] == "e.2.1"


def test_the_turns_of_an_episode_are_logged(host, log):
    give(host, configure())
    give(host, m.EpisodeAbort(header=HEADER, reason="cancelled"))
    prepared, aborted = lines(log)
    assert prepared["service"] == "hand"
    assert prepared["event"] == "episode prepared"
    asked = {"task": "lid", "robot": "panda", "policy": "expert", "seed": 3}
    assert (EPISODE | asked).items() <= prepared.items()
    assert (aborted["event"], aborted["reason"]) == ("episode aborted", "cancelled")
    assert aborted.items() >= EPISODE.items()


def test_an_episode_that_cannot_begin_is_logged_with_the_reason(host, log):
    give(host, configure(task="cup"))
    (refused,) = lines(log)
    assert (refused["event"], refused["code"]) == ("episode refused", "E-INVALID-VALUE")
    assert refused.items() >= EPISODE.items()


def test_nothing_is_logged_of_episodes_of_others(host, log):
    give(host, configure(nodes={}))
    give(host, m.EpisodeAbort(header=HEADER, reason="cancelled"))
    assert lines(log) == []


def test_nothing_is_logged_per_tick(host, log):
    give(host, configure())
    state = m.RobotState(header=HEADER, positions=[0.0], velocities=[0.0])
    for _ in range(50):
        give(host, state)
        host.tick(0)
    assert len(lines(log)) == 1


def test_a_rejected_message_names_the_episode_of_its_cell(log):
    with open_session(BusSettings("in_process")) as session, Bus(session) as bus:
        host = Host(Hand(), bus, node="hand")
        host.start()
        bus.publish(configure(), owner="sim-0", mode="lockstep")
        host.spin()
        key, encoding = key_of(topic_of(m.RobotState), "sim-0"), encoding_of(m.RobotState)
        session.put(key, b"\xff", encoding=encoding)
        host.spin()
    rejected = lines(log)[-1]
    assert rejected["event"] == "message rejected"
    assert rejected.items() >= EPISODE.items()
