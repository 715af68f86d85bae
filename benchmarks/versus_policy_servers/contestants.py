"""Who is measured: servers that stay up, and a client that makes blocks of round trips."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Generator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.environments import ROOT
from client.deployment import find_free_ports

PACKAGE = "benchmarks.versus_policy_servers"
SETTINGS = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
LEGATO = "LEGATO through its router"
WEBSOCKET = "websocket, form of openpi"
GRPC = "gRPC, form of LeRobot"
GRPC_AFTER = "gRPC, asked after sending"


@dataclass(frozen=True)
class Contestant:
    """The processes of one way to serve a policy.

    Args:
        name: In the tables.
        servers: Their command lines.
        client: Its command line.
        servers_tell: Whether the servers print a line when they are ready; else the client waits.
    """

    name: str
    servers: Sequence[Sequence[str]]
    client: Sequence[str]
    servers_tell: bool = True


class Client:
    """A client that is up and connected."""

    def __init__(self, name: str, process: subprocess.Popen[str]) -> None:
        self._name = name
        self._process = process

    def measure(self, *, count: int, period_s: float) -> list[float]:
        """Make round trips, one at a time.

        Args:
            count: How many.
            period_s: Time from one to the next; 0 is back to back.

        Returns:
            How long each took [µs].

        Raises:
            SystemExit: The client has ended.
        """
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps([count, period_s]) + "\n")
        self._process.stdin.flush()
        return [1e-3 * ns for ns in read_answer(self._process, self._name)]


def make_contestants(python: Path, *, steps: int) -> list[Contestant]:
    """All of them, each with ports of its own.

    Args:
        python: Of the environment of those that are not ours.
        steps: Of one answer.
    """
    length = str(steps)
    router, websocket, grpc, grpc_after = find_free_ports(4)
    own = (sys.executable, "-m")
    other = (str(python), "-m")
    routing = (*own, "services.router", f"--listen=127.0.0.1:{router}", "--namespace=versus")
    legato = (*own, f"{PACKAGE}.legato_form")
    by_websocket = (*other, f"{PACKAGE}.websocket_form")
    by_grpc = (*other, f"{PACKAGE}.grpc_form")
    return [
        Contestant(
            LEGATO,
            [routing, (*legato, "serve", str(router), length)],
            (*legato, "ask", str(router), length),
            servers_tell=False,
        ),
        Contestant(
            WEBSOCKET,
            [(*by_websocket, "serve", str(websocket), length)],
            (*by_websocket, "ask", str(websocket), length),
        ),
        Contestant(
            GRPC,
            [(*by_grpc, "serve", str(grpc), length)],
            (*by_grpc, "thread", str(grpc), length),
        ),
        Contestant(
            GRPC_AFTER,
            [(*by_grpc, "serve", str(grpc_after), length)],
            (*by_grpc, "after", str(grpc_after), length),
        ),
    ]


@contextmanager
def started(contestant: Contestant) -> Generator[Client, None, None]:
    """Start the servers and the client of a contestant; stop them in every case.

    Raises:
        SystemExit: One of them ends before it is ready.
    """
    with ExitStack() as stack:
        for command in contestant.servers:
            server = stack.enter_context(_running(command))
            if contestant.servers_tell:
                read_answer(server, contestant.name)
        client = stack.enter_context(_running(contestant.client))
        read_answer(client, contestant.name)
        yield Client(contestant.name, client)


def read_answer(process: subprocess.Popen[str], name: str) -> Any:
    """The next line that a process prints.

    Raises:
        SystemExit: It has ended.
    """
    assert process.stdout is not None
    line = process.stdout.readline()
    if not line:
        raise SystemExit(f"{name}: a process has ended; what it said stands above")
    return json.loads(line)


@contextmanager
def _running(command: Sequence[str]) -> Generator[subprocess.Popen[str], None, None]:
    process = subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env=os.environ | SETTINGS,
    )
    try:
        yield process
    finally:
        process.terminate()
        process.communicate()
