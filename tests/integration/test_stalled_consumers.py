"""A consumer that stops reading: nobody waits for it, and nothing piles up for it."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Self

import psutil
import pytest

from client.deployment import find_free_ports
from common.api import PREFIX, EvaluationRequest
from common.metrics import table as t
from common.topics import topic_named
from tests.bus_processes import FRAME_BYTES
from tests.deployments import first_of_free_ports, running, wait_for_running_trial
from tests.integration.test_rest_processes import Processes
from tests.metrics_scrape import scrape

pytestmark = pytest.mark.processes

FLOOD = 4000
"""Messages of 33 kB: 131 MB."""
LARGEST_GROWTH = 40e6
assert LARGEST_GROWTH < FLOOD * FRAME_BYTES / 3
TICKS = 300
FOLLOWERS = 3
WAIT_S = 240.0
"""Bound of every wait; reached only by a test that fails."""


def wait_until(condition: Callable[[], bool]) -> None:
    pause = threading.Event()
    deadline_s = time.monotonic() + WAIT_S
    while not condition():
        assert time.monotonic() < deadline_s, "waited in vain"
        pause.wait(0.02)


class BusProcess:
    """A publisher or subscriber, and how often it has said each of its words."""

    def __init__(self, role: str, endpoint: str, namespace: str, topic: str) -> None:
        self.said = Counter[str]()
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.bus_processes", role, endpoint, namespace, topic],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()
        self._reader.join()
        for stream in (self.process.stdin, self.process.stdout):
            assert stream is not None
            stream.close()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.said[line.strip()] += 1

    def send(self, count: int) -> None:
        """Let a publisher send messages, and return when it has."""
        sent = self.said["sent"]
        assert self.process.stdin is not None
        self.process.stdin.write(f"{count}\n")
        self.process.stdin.flush()
        wait_until(lambda: self.said["sent"] > sent)


def memory(pid: int) -> int:
    return psutil.Process(pid).memory_info().rss


@contextmanager
def router_process(port: int) -> Iterator[subprocess.Popen[bytes]]:
    arguments = [sys.executable, "-m", "services.router", f"--listen=127.0.0.1:{port}"]
    process = subprocess.Popen(arguments, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def send_until_heard(publisher: BusProcess, *subscribers: BusProcess) -> None:
    before = [each.said["came"] for each in subscribers]

    def heard() -> bool:
        publisher.send(1)
        return all(
            each.said["came"] > count for each, count in zip(subscribers, before, strict=True)
        )

    wait_until(heard)


@pytest.mark.parametrize("topic", ["camera/stereo", "episode/picture"])
def test_a_flood_past_a_stalled_subscriber_costs_bounded_memory(topic: str):
    """A topic that drops and one that waits; far more than any queue holds."""
    assert topic_named(topic).lossless == (topic == "episode/picture")
    (port,) = find_free_ports(1)
    where = (f"tcp/127.0.0.1:{port}", "flood", topic)
    with (
        router_process(port) as router,
        BusProcess("subscribe", *where) as stalled,
        BusProcess("subscribe", *where) as reading,
        BusProcess("publish", *where) as publisher,
    ):
        # What is sent before the router knows of a subscriber goes to nobody.
        send_until_heard(publisher, stalled, reading)
        before = {pid: memory(pid) for pid in (router.pid, publisher.process.pid)}
        stalled.process.send_signal(signal.SIGSTOP)
        publisher.send(FLOOD)
        grown = [memory(pid) - bytes_before for pid, bytes_before in before.items()]
        stalled.process.send_signal(signal.SIGCONT)
        assert max(grown) < LARGEST_GROWTH
        # The others still hear, and so does the stalled one when it is back.
        send_until_heard(publisher, stalled, reading)


def test_a_real_time_simulation_waits_for_nobody(tmp_path: Path):
    """Who takes no part is stopped in an episode; the loss of who does would end it."""
    request = EvaluationRequest(
        tasks=["lid"], robots=["abstract"], policy="hold", mode="realtime", pictures=False
    )
    with (
        running(tmp_path, robots=("abstract",), metrics_port=first_of_free_ports()) as (
            deployment,
            supervisor,
            client,
        ),
        BusProcess(
            "subscribe", deployment.endpoint, deployment.namespace, "robot/state"
        ) as listener,
    ):
        nodes = [spec.node for spec in deployment.processes()]
        ports = dict(zip(nodes, deployment.metrics_ports(), strict=True))

        def ticks() -> float:
            return scrape(ports["sim-0"]).value(t.PUBLISHED, topic="robot/state")

        evaluation = client.submit(request).id
        wait_for_running_trial(client, evaluation)
        wait_until(lambda: listener.said["came"] > 0)
        before = {node: memory(supervisor.pids[node]) for node in nodes}
        begun = ticks()
        listener.process.send_signal(signal.SIGSTOP)
        wait_until(lambda: ticks() >= begun + TICKS)
        for node in set(nodes) - {"router"}:
            for labels, waiting in scrape(ports[node]).each(t.WAITING):
                # Of one cell, or of each node.
                assert waiting <= topic_named(labels["topic"]).depth * len(nodes)
        for node in nodes:
            assert memory(supervisor.pids[node]) - before[node] < LARGEST_GROWTH, node
        client.cancel(evaluation)


class Quiet(Processes):
    """Nobody reads what they log."""

    def spawn(self, module: str, *arguments: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, "-m", module, *arguments],
            stderr=subprocess.DEVNULL,
            text=True,
            start_new_session=True,
        )
        self.started.append(process)
        return process

    def post_grid(self) -> str:
        """An evaluation whose every event is of some size."""
        body = {
            "tasks": ["lid"],
            "robots": ["abstract", "panda"],
            "policies": ["expert", "random"],
            "trials": 8,
        }
        return self.http.post(f"{PREFIX}/evaluations", json=body).raise_for_status().json()["id"]


@pytest.fixture
def plane(tmp_path) -> Iterator[Quiet]:
    interval_s = sys.getswitchinterval()
    processes = Quiet(tmp_path / "runs")
    processes.router = processes.start_router()
    processes.control = processes.start_control()
    processes.start_nodes()
    wait_until(processes.is_ready)
    yield processes
    processes.close()
    sys.setswitchinterval(interval_s)


def follow(port: int, evaluation: str) -> socket.socket:
    """Ask for the events of an evaluation with little room for the answer."""
    follower = socket.socket()
    follower.settimeout(30.0)
    follower.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    follower.connect(("127.0.0.1", port))
    path = f"{PREFIX}/evaluations/{evaluation}/events"
    follower.sendall(f"GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
    return follower


def test_followers_that_do_not_read_hold_up_nobody(plane: Quiet):
    with ExitStack() as stack:
        plane.sim.hold.set()
        evaluation = plane.post_grid()
        followers = [stack.enter_context(follow(plane.port, evaluation)) for _ in range(FOLLOWERS)]
        for follower in followers:
            assert follower.recv(12) == b"HTTP/1.1 200"
        before = memory(plane.control.pid)
        plane.sim.hold.clear()
        wait_until(lambda: plane.evaluation(evaluation)["status"] == "done")
        assert memory(plane.control.pid) - before < LARGEST_GROWTH
        # One of them goes on, and is told all that counts.
        told = b""
        while b"event: end" not in told:
            received = followers[0].recv(65536)
            assert received, "the stream was closed before its end"
            told += received
        # It was behind by more than the system keeps for it.
        assert len(told) > 200_000
        # Those that still do not read do not keep the process.
        plane.control.send_signal(signal.SIGTERM)
        assert plane.control.wait(30.0) == 0
