"""Threads of Zenoh in the processes of a deployment."""

from __future__ import annotations

import os
import sys
import time
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
        kinds: dict[str, set[str]] = {}
        for node in ("router", "gripper"):
            wait_until_ready(tmp_path / f"{node}.log")
            kinds[node] = kinds_of_threads(supervisor.pids[node])
    # A setting that Zenoh does not understand would leave all of them.
    assert kinds["gripper"] == {"rx", "tx"}
    # A relay must not send on the thread on which it waits for a link that is full.
    assert kinds["router"] >= {"rx", "tx", "app", "net"}


def kinds_of_threads(pid: int) -> set[str]:
    """First parts of names such as `rx-0`."""
    tasks = Path(f"/proc/{pid}/task")
    names = [(tasks / task / "comm").read_text().strip() for task in os.listdir(tasks)]
    return {name.partition("-")[0] for name in names if "-" in name}


def wait_until_ready(path: Path) -> None:
    deadline_s = time.monotonic() + WAIT_S
    while not path.exists() or '"ready"' not in path.read_text():
        assert time.monotonic() < deadline_s, f"{path.stem} is not ready"
        time.sleep(0.02)
