"""The bus over real Zenoh sessions: in one process, over a Unix socket, and its known pitfalls."""

from __future__ import annotations

import ast
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
import zenoh

from common import messages as m
from common.bus import Bus, BusSettings, Inbox, Received, decode, open_session
from common.bus.threads import KeptThreads
from common.errors import InvalidValue, PortInUse, RouterUnreachable
from common.topics import topic_of

ROOT = Path(__file__).parents[2]


def free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


@contextmanager
def bus(settings: BusSettings) -> Iterator[Bus]:
    with open_session(settings) as session, Bus(session) as opened:
        yield opened


@contextmanager
def hub_and(count: int, namespace: str) -> Iterator[tuple[BusSettings, list[Bus]]]:
    """A router and some clients of it, all in this process."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    settings = BusSettings("client", endpoint, namespace)
    with ExitStack() as stack:
        stack.enter_context(open_session(BusSettings("router", endpoint)))
        yield settings, [stack.enter_context(bus(settings)) for _ in range(count)]


def state(step: int) -> m.RobotState:
    return m.RobotState(
        header=m.Header(cell="c", epoch=1, step=step), positions=[0.0], velocities=[0.0]
    )


def wait_for(
    inbox: Inbox, count: int, timeout_s: float = 5.0
) -> tuple[list[object], list[Received]]:
    events: list[object] = []
    items: list[Received] = []
    deadline = time.monotonic() + timeout_s
    while len(events) + len(items) < count and time.monotonic() < deadline:
        inbox.wait(0.05)
        more_events, more_items = inbox.drain()
        events += more_events
        items += more_items
    return events, items


def test_in_process_delivery_is_synchronous_and_needs_no_port():
    with bus(BusSettings("in_process", namespace="t")) as b:
        inbox = Inbox()
        b.subscribe(topic_of(m.RobotState), inbox)
        b.publish(state(7), owner="c", mode="lockstep")
        _, items = inbox.drain()
        message = decode(items[0].topic, items[0].encoding, items[0].payload)
        assert message == state(7)


def test_two_in_process_sessions_do_not_meet():
    settings = BusSettings("in_process", namespace="t")
    with bus(settings) as one, bus(settings) as two:
        inbox = Inbox()
        two.subscribe(topic_of(m.RobotState), inbox)
        one.publish(state(1), owner="c", mode="lockstep")
        assert not inbox.wait(0.1)


def test_the_first_message_to_a_living_subscriber_is_not_lost():
    """Declared publishers lose it until they hear of the subscriber; ours are not declared."""
    lost = 0
    for attempt in range(10):
        with hub_and(2, f"first{attempt}") as (_, (sender, receiver)):
            inbox, alive = Inbox(), Inbox()
            receiver.subscribe(topic_of(m.RobotState), inbox)
            receiver.declare_alive("sim", "r")
            sender.watch_alive(alive)
            wait_for(alive, 1)
            sender.publish(state(1), owner="c", mode="lockstep")
            _, items = wait_for(inbox, 1, timeout_s=1.0)
            lost += not items
    assert lost == 0


def test_namespaces_on_one_router_are_apart():
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with (
        open_session(BusSettings("router", endpoint)),
        bus(BusSettings("client", endpoint, "one")) as one,
        bus(BusSettings("client", endpoint, "two")) as two,
    ):
        inbox = Inbox()
        two.subscribe(topic_of(m.RobotState), inbox)
        two.watch_alive(inbox)
        one.declare_alive("sim", "x")
        one.publish(state(1), owner="c", mode="lockstep")
        assert not inbox.wait(0.3)


def test_nodes_are_seen_coming_and_going():
    with hub_and(1, "alive") as (settings, (watcher,)):
        inbox = Inbox()
        watcher.watch_alive(inbox)
        with bus(settings) as node:
            node.declare_alive("gripper", "g1")
            up, down = m.NodeUp("gripper", "g1"), m.NodeDown("gripper", "g1")
            assert wait_for(inbox, 1)[0][0] == up
            assert watcher.list_alive() == [("gripper", "g1")]
        # A token may be told twice, as one that is there and as one that comes.
        events, deadline_s = [up], time.monotonic() + 5.0
        while down not in events and time.monotonic() < deadline_s:
            events += wait_for(inbox, 1)[0]
        assert events[-1] == down
        assert set(events[:-1]) == {up}


def test_a_description_is_asked_and_answered():
    with hub_and(2, "describe") as (_, (asker, node)):
        questions, answers = Inbox(), Inbox()
        asker.watch_alive(answers)
        node.serve_description("g1", questions)
        node.declare_alive("gripper", "g1")
        wait_for(answers, 1)
        asker.ask_description("g1", answers)
        (request,), _ = wait_for(questions, 1)
        description = m.NodeDescription(
            header=m.Header(),
            kind="gripper",
            node="g1",
            code_version="1",
            packages={},
            host="h",
            pid=1,
            started_unix_s=0.0,
            offers={},
        )
        request.answer(description)  # type: ignore[attr-defined]
        _, (item,) = wait_for(answers, 1)
        assert decode(item.topic, item.encoding, item.payload) == description


def test_asking_a_node_that_does_not_exist_gives_nothing():
    """Zenoh reports no error for a missing queryable: silence must be treated as failure."""
    with hub_and(1, "nobody") as (_, (asker,)):
        inbox = Inbox()
        asker.ask_description("nobody", inbox)
        assert not inbox.wait(0.3)


def test_no_router_is_a_clear_error():
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with (
        pytest.raises(RouterUnreachable, match="legato up"),
        open_session(BusSettings("client", endpoint), wait_s=0.2),
    ):
        pass


def test_waiting_for_a_router_obeys_stop():
    stop = threading.Event()
    threading.Timer(0.2, stop.set).start()
    started = time.monotonic()
    with (
        pytest.raises(RouterUnreachable),
        open_session(BusSettings("client", f"tcp/127.0.0.1:{free_port()}"), stop=stop, wait_s=60),
    ):
        pass
    assert time.monotonic() - started < 30


@pytest.mark.parametrize("lease_s", [0.1, 61.0, float("nan")])
def test_a_lease_that_would_lose_everybody_or_nobody_is_refused(lease_s: float):
    with pytest.raises(InvalidValue, match="--lease-s"):
        BusSettings(asked_lease_s=lease_s)


def test_a_router_port_in_use_is_a_clear_error():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with (
            pytest.raises(PortInUse, match=str(port)),
            open_session(BusSettings("router", f"tcp/127.0.0.1:{port}")),
        ):
            pass


def test_a_process_that_dies_of_an_exception_does_not_hang():
    """Zenoh hangs at exit after an indirect callback without close; ours are direct and closed."""
    script = """
from common.bus import Bus, BusSettings, Inbox, open_session
from common.messages import RobotState
from common.topics import topic_of
with open_session(BusSettings("in_process", namespace="x")) as session:
    bus = Bus(session)
    bus.subscribe(topic_of(RobotState), Inbox())
    raise SystemExit(3)
"""
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, timeout=20, check=False)
    assert done.returncode == 3


def test_a_stalled_consumer_does_not_block_the_sender_for_long():
    """BLOCK to a stalled peer freezes a sender for `wait_before_close`; ours is 0.5 s, once."""
    with hub_and(1, "stall") as (settings, (sender,)):
        script = f"""
import time
from common.bus import *
from common.messages import StereoFrame
from common.topics import topic_of
from common.bus.bus import Bus
with open_session(BusSettings("client", "{settings.endpoint}", "stall")) as session:
    bus = Bus(session)
    inbox = Inbox()
    bus.subscribe(topic_of(StereoFrame), inbox)
    bus.declare_alive("sim", "slow")
    # Zenoh's own thread sends the token: stopped at once, it would never go out.
    time.sleep(0.5)
    import os, signal
    os.kill(os.getpid(), signal.SIGSTOP)
"""
        alive = Inbox()
        sender.watch_alive(alive)
        consumer = subprocess.Popen([sys.executable, "-c", script], cwd=ROOT)
        try:
            assert wait_for(alive, 1, timeout_s=20)[0]
            pixels = bytes(1024 * 1024)
            frame = m.StereoFrame(
                header=m.Header(cell="c"),
                camera="t265",
                width=1024,
                height=1024,
                left=pixels,
                right=pixels,
                due_step=0,
            )
            longest = 0.0
            for _ in range(30):
                started = time.monotonic()
                sender.publish(frame, owner="c", mode="realtime")
                longest = max(longest, time.monotonic() - started)
            # In real time a full link drops: far below the 0.5 s of a blocked one.
            assert longest < 0.4
        finally:
            consumer.kill()
            consumer.wait()


def test_matching_status_is_never_used_as_a_truth_value():
    """`matching_status` is an object, always true: code that branches on it loses messages."""
    assert "__bool__" not in vars(zenoh.MatchingStatus)
    for path in [*ROOT.glob("common/**/*.py"), *ROOT.glob("services/**/*.py")]:
        for node in ast.walk(ast.parse(path.read_text())):
            assert getattr(node, "attr", "") != "matching_status", path


def test_callbacks_are_direct():
    """Indirect callbacks add a thread per subscriber and hang a process that forgets to close."""
    source = (ROOT / "common/bus/bus.py").read_text()
    calls = [
        node
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and node.func.attr.startswith("declare_")
        and node.func.attr not in {"declare_token", "declare_keyexpr"}
    ]
    assert calls
    for call in calls:
        handlers = [
            a for a in call.args if isinstance(a, ast.Call) and ast.unparse(a.func) == "_direct"
        ]
        assert len(handlers) == 1, ast.unparse(call)


def test_a_thread_of_zenoh_keeps_its_state_from_one_callback_to_the_next():
    """What is local to a thread is part of its state, and goes with it."""
    kept, local = KeptThreads(), threading.local()
    counted: list[int] = []
    done = threading.Event()

    def count(sample: zenoh.Sample) -> None:
        kept.keep()
        local.calls = getattr(local, "calls", 0) + 1
        counted.append(local.calls)
        if sample.payload.to_bytes() == b"last":
            done.set()

    endpoint = f"tcp/127.0.0.1:{free_port()}"
    settings = BusSettings("client", endpoint, "threads")
    with (
        open_session(BusSettings("router", endpoint)),
        open_session(settings) as sender,
        open_session(settings) as receiver,
    ):
        callback = zenoh.handlers.Callback(count, indirect=False)
        with receiver.declare_subscriber("a", callback):
            publisher = sender.declare_publisher("a")
            deadline = time.monotonic() + 5.0
            while not publisher.matching_status.matching and time.monotonic() < deadline:
                time.sleep(0.01)
            for number in range(20):
                publisher.put(b"last" if number == 19 else b"")
            assert done.wait(30.0)
    # Zenoh receives on two threads.
    assert max(counted) >= 10
