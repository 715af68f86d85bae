"""SIGUSR1 asks a process where it is, and the process goes on."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest

from client.deployment import ProcessSpec, find_free_ports
from client.supervisor import Supervisor

pytestmark = pytest.mark.processes

WAIT_S = 60.0
"""Reached only by a test that fails."""


def test_a_process_writes_its_stacks_and_goes_on(tmp_path: Path):
    (port,) = find_free_ports(1)
    listen = ProcessSpec("router", "router", "services.router", (f"--listen=127.0.0.1:{port}",))
    with Supervisor([listen], logs=tmp_path) as supervisor:
        supervisor.start()
        path = tmp_path / "router.log"
        wait_for_text(path, '"ready"')
        pid = supervisor.pids["router"]
        os.kill(pid, signal.SIGUSR1)
        wait_for_text(path, "most recent call first")
        wait_for_text(path, "common/service.py")
        assert supervisor.pids["router"] == pid
    lines = path.read_text().splitlines()
    # It stopped in good order.
    assert any('"stopping"' in line for line in lines)


def wait_for_text(path: Path, text: str) -> None:
    deadline_s = time.monotonic() + WAIT_S
    while not path.exists() or text not in path.read_text():
        assert time.monotonic() < deadline_s, f"{text} is not in {path.name}"
        time.sleep(0.02)
