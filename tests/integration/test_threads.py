"""Threads of Zenoh in the processes of a deployment."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from client.deployment import ProcessSpec, find_free_ports
from client.supervisor import Supervisor

pytestmark = [
    pytest.mark.processes,
    pytest.mark.skipif(sys.platform != "linux", reason="names of threads are read from /proc"),
]

WAIT_S = 60.0
"""Reached only by a test that fails."""


def test_clients_have_few_threads_and_the_router_has_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    # A choice of whoever runs the tests would be kept.
    monkeypatch.delenv("ZENOH_RUNTIME", raising=False)
    (port,) = find_free_ports(1)
    endpoint = f"--endpoint=tcp/127.0.0.1:{port}"
    specs = [
        ProcessSpec("router", "router", "services.router", (f"--listen=127.0.0.1:{port}",)),
        ProcessSpec("gripper", "gripper", "services.gripper", (endpoint,)),
    ]
    with Supervisor(specs, logs=tmp_path) as supervisor:
        supervisor.start()
        for node in ("router", "gripper"):
            wait_until(lambda node=node: is_ready(tmp_path / f"{node}.log"), f"{node} is ready")
        router, gripper = (supervisor.pids[node] for node in ("router", "gripper"))
        # A relay must not send on the thread on which it waits for a link that is full.
        wait_until(lambda: kinds_of_threads(router) >= {"rx", "tx", "app", "net"}, "all kinds")
        wait_until(lambda: kinds_of_threads(gripper) >= {"rx", "tx"}, "both kinds")
        # A setting that Zenoh does not understand would leave all of them.
        assert kinds_of_threads(gripper) == {"rx", "tx"}


def kinds_of_threads(pid: int) -> set[str]:
    """First parts of names such as `rx-0`."""
    tasks = Path(f"/proc/{pid}/task")
    names = [(tasks / task / "comm").read_text().strip() for task in os.listdir(tasks)]
    return {name.partition("-")[0] for name in names if "-" in name}


def is_ready(log: Path) -> bool:
    return log.exists() and '"ready"' in log.read_text()


def wait_until(condition: Callable[[], bool], what: str) -> None:
    deadline_s = time.monotonic() + WAIT_S
    while not condition():
        assert time.monotonic() < deadline_s, f"waited in vain: {what}"
        time.sleep(0.02)
