"""A reactor on the bus: fencing, stamping, counting, and what happens to bad messages."""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import pytest

from common import messages as m
from common.bus import Bus, BusSettings, Inbox, decode, open_session
from common.bus.codec import encode, encoding_of
from common.service import AnyMessage, Host, InlineRunner, Reactor
from common.topics import key_of, topic_of

ROOT = Path(__file__).parents[2]
CELL = "sim-0"


class Echo(Reactor):
    """Answers every robot state with a command that repeats its positions."""

    kind = "retarget"
    inputs = (m.EpisodeConfigure, m.RobotState)
    watches_nodes = True

    def __init__(self) -> None:
        self.seen: list[AnyMessage] = []
        self.muted = False

    def serves(self, cell: str) -> bool:
        return not self.muted

    def offers(self) -> dict[str, list[str]]:
        return {"robots": ["echo"]}

    def handle(self, messages: Sequence[AnyMessage]) -> Iterable[AnyMessage]:
        for message in messages:
            if not isinstance(message, m.Tick):
                self.seen.append(message)
            if isinstance(message, m.RobotState):
                yield m.RobotCommand(
                    header=m.Header(cell=CELL, epoch=message.header.epoch, step=1),
                    for_step=message.header.step,
                    request_t_mono_ns=message.header.t_mono_ns,
                    positions=message.positions,
                    velocities=message.velocities,
                )
            elif isinstance(message, m.NodeUp):
                yield m.AskDescription(message.node)


@pytest.fixture
def bus() -> Iterator[Bus]:
    with (
        open_session(BusSettings("in_process", namespace="host")) as session,
        Bus(session) as opened,
    ):
        yield opened


@pytest.fixture
def raw() -> Iterator[tuple[object, Host, Echo, Inbox]]:
    """The session itself, a host of an echo, and an inbox with its answers."""
    with (
        open_session(BusSettings("in_process", namespace="host")) as session,
        Bus(session) as opened,
    ):
        echo = Echo()
        host = Host(echo, opened, node="echo")
        answers = Inbox()
        opened.subscribe(topic_of(m.RobotCommand), answers)
        host.start()
        # It sees itself come up, asks what it is, and is told.
        while host.spin():
            pass
        yield session, host, echo, answers


def configure(epoch: int) -> m.EpisodeConfigure:
    return m.EpisodeConfigure(
        header=m.Header(cell=CELL, epoch=epoch, seq=1),
        task="lid",
        robot="abstract",
        policy="expert",
        seed=0,
        mode="lockstep",
        nodes={},
    )


def state(epoch: int, step: int = 0, seq: int = 1) -> m.RobotState:
    return m.RobotState(
        header=m.Header(cell=CELL, source="sim-0", epoch=epoch, step=step, seq=seq, t_mono_ns=5),
        positions=[1.0],
        velocities=[2.0],
    )


def send(session: object, message: m.Message, *, encoding: str | None = None) -> None:
    session.put(  # type: ignore[attr-defined]
        key_of(topic_of(type(message)), CELL),
        encode(message),
        encoding=encoding or encoding_of(type(message)),
    )


def states(echo: Echo) -> list[m.RobotState]:
    return [x for x in echo.seen if isinstance(x, m.RobotState)]


def test_answers_are_stamped_and_echo_the_request(raw):
    session, host, _, answers = raw
    send(session, configure(1))
    host.spin()
    for step in (0, 1):
        send(session, state(1, step))
        host.spin()
        _, (item,) = answers.drain()
        reply = decode(item.topic, item.encoding, item.payload)
        assert isinstance(reply, m.RobotCommand)
        assert reply.header.source == "echo"
        assert reply.header.seq == step + 1
        assert reply.header.t_mono_ns > 0
        assert reply.request_t_mono_ns == 5


def test_messages_of_another_epoch_are_dropped_and_counted(raw):
    session, host, echo, _ = raw
    send(session, configure(2))
    host.spin()
    for epoch in (1, 3):
        send(session, state(epoch))
        host.spin()
    assert states(echo) == []
    assert host.metrics().stale == 2
    send(session, state(2))
    host.spin()
    assert len(states(echo)) == 1


def test_a_configuration_of_an_old_epoch_is_stale(raw):
    session, host, echo, _ = raw
    send(session, configure(5))
    host.spin()
    send(session, configure(4))
    host.spin()
    assert [x.header.epoch for x in echo.seen if isinstance(x, m.EpisodeConfigure)] == [5]
    assert host.metrics().stale == 1


def test_wrong_schema_is_rejected_counted_and_logged_once(raw, caplog):
    session, host, echo, _ = raw
    send(session, configure(1))
    host.spin()
    with caplog.at_level(logging.WARNING):
        for _ in range(3):
            send(session, state(1), encoding="application/msgpack;legato.RobotState.v99")
            host.spin()
    assert states(echo) == []
    assert host.metrics().rejected == 3
    assert [r.message for r in caplog.records] == ["message rejected"]
    assert "v99" in caplog.records[0].happened


def test_noise_on_a_topic_is_rejected_and_work_goes_on(raw):
    session, host, echo, _ = raw
    send(session, configure(1))
    host.spin()
    session.put(
        key_of(topic_of(m.RobotState), CELL), b"\xff\x00", encoding=encoding_of(m.RobotState)
    )
    host.spin()
    send(session, state(1))
    host.spin()
    assert len(states(echo)) == 1
    assert host.metrics().rejected == 1


def test_what_speaks_of_another_cell_or_node_is_rejected(raw, caplog):
    """Who may write on the key of one cell must not reach another one through it."""
    session, host, echo, _ = raw
    send(session, configure(1))
    host.spin()
    elsewhere = m.Header(cell="sim-1", epoch=1)
    with caplog.at_level(logging.WARNING):
        for message in (
            configure(2).model_copy(update={"header": m.Header(cell="sim-1", epoch=2)}),
            state(1).model_copy(update={"header": elsewhere}),
        ):
            send(session, message)
            host.spin()
    assert states(echo) == []
    assert len([x for x in echo.seen if isinstance(x, m.EpisodeConfigure)]) == 1
    assert host.metrics().rejected == 2
    assert {record.code for record in caplog.records} == {"E-FOREIGN"}
    send(session, state(1))
    host.spin()
    assert len(states(echo)) == 1


def test_a_node_is_described_by_itself_only(bus):
    class Board(Echo):
        inputs = (m.NodeMetrics, m.PolicyLoaded)

    board = Board()
    host = Host(board, bus, node="retarget-0")
    host.start()
    beat = host.metrics()
    loaded = m.PolicyLoaded(header=m.Header(), request="r", node="policy-2", policy="p")
    for owner in ("policy-1", "policy-2", "retarget-0"):
        for message in (beat, loaded):
            bus.publish(message, owner=owner, mode="lockstep")
            host.spin()
    heard = [x for x in board.seen if isinstance(x, m.NodeMetrics | m.PolicyLoaded)]
    assert heard == [loaded, beat]
    assert host.metrics().rejected == 4


def test_a_node_says_in_which_cells_it_has_rights(bus):
    everywhere, limited = (
        Host(Echo(), bus, node="echo", cells=cells) for cells in (("*",), ("sim-0", "b-*"))
    )
    assert everywhere.describe().offers == {"robots": ["echo"]}
    assert limited.describe().offers == {"robots": ["echo"], "only_cells": ["sim-0", "b-*"]}


def test_missing_sequence_numbers_are_counted(raw):
    session, host, _, _ = raw
    send(session, configure(1))
    host.spin()
    for step, seq in enumerate([1, 2, 5, 6, 9]):
        send(session, state(1, step, seq))
        host.spin()
    assert host.metrics().gaps == 4


def test_only_cells_that_concern_it_are_heard(raw):
    """Not subscribed at all: an idle process must not be woken by the data of others."""
    session, host, echo, _ = raw
    for epoch, serves in [(1, False), (2, True), (3, True), (4, False)]:
        echo.muted = not serves
        send(session, configure(epoch))
        host.spin()
        send(session, state(epoch))
        assert host.inbox.wait(0.0) == serves
        host.spin()
    assert [x.header.epoch for x in states(echo)] == [2, 3]


def test_it_sees_itself_come_up_and_reads_its_own_description(raw):
    _, _, echo, _ = raw
    assert echo.seen[0] == m.NodeUp("retarget", "echo")
    (description,) = [x for x in echo.seen if isinstance(x, m.NodeDescription)]
    assert description.offers == {"robots": ["echo"]}
    assert description.pid == os.getpid()


def test_heartbeats_carry_the_counters(bus: Bus):
    host = Host(Echo(), bus, node="echo")
    beats = Inbox()
    bus.subscribe(topic_of(m.NodeMetrics), beats)
    host.start()
    for t_s in (1.0, 1.5, 2.1):
        host.tick(int(t_s * 1e9))
    _, items = beats.drain()
    assert [decode(i.topic, i.encoding, i.payload).node for i in items] == ["echo", "echo"]


def test_local_outputs_go_to_the_sink(bus: Bus):
    class Local(Reactor):
        kind = "control"
        inputs = ()

        def handle(self, messages: Sequence[AnyMessage]) -> Iterable[AnyMessage]:
            return [x for x in messages if isinstance(x, m.NodeUp)]

    taken: list[m.LocalMessage] = []
    host = Host(Local(), bus, node="local", sink=taken.append)
    host.inbox.put_event(m.NodeUp("sim", "a"))
    InlineRunner([host]).run(until=lambda: bool(taken))
    assert taken == [m.NodeUp("sim", "a")]


PROCESS = """
import sys
sys.path.insert(0, {root!r})
from tests.integration.test_host import Echo
from common.bus import BusSettings
from common.service import run_process
run_process(Echo(), BusSettings("in_process", namespace="p"), node="echo", parent_pid={parent},
            on_host=lambda host, stop: print("ready", flush=True))
"""


def start_process(parent: str) -> subprocess.Popen[str]:
    script = PROCESS.format(root=str(ROOT), parent=parent)
    process = subprocess.Popen(
        [sys.executable, "-c", script], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


@pytest.mark.processes
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_process_ends_cleanly_when_told(number: signal.Signals):
    process = start_process("None")
    process.send_signal(number)
    assert process.wait(timeout=10) == 0
    process.communicate()


@pytest.mark.processes
def test_a_process_does_not_outlive_its_parent():
    process = start_process("1" if os.getppid() != 1 else "2")
    assert process.wait(timeout=10) == 0
    process.communicate()


def test_time_reaches_a_reactor_as_a_message(bus: Bus):
    ticks: list[int] = []

    class Watch(Reactor):
        kind = "sim"
        inputs = ()

        def handle(self, messages: Sequence[AnyMessage]) -> Iterable[AnyMessage]:
            ticks.extend(x.t_mono_ns for x in messages if isinstance(x, m.Tick))
            return []

    started = time.monotonic_ns()
    InlineRunner([Host(Watch(), bus, node="w")]).run(until=lambda: len(ticks) == 3)
    assert ticks == sorted(ticks)
    assert ticks[0] >= started
    assert ticks[2] - ticks[0] >= 0.19e9
