"""Processes say where they are: when they are asked, and when they do not come to their end."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
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


HANGING = """
import ctypes, os, signal, threading
from common.service import install_stop_signals

stop = threading.Event()
install_stop_signals(stop, end_s=0.5)
os.kill(os.getpid(), signal.SIGTERM)
assert stop.is_set()
# Holds Python while it sleeps: no other thread of Python can do anything.
ctypes.PyDLL(None).sleep(600)
"""


def test_a_process_that_hangs_when_told_to_stop_says_where_and_ends():
    hanging = subprocess.run(
        [sys.executable, "-c", HANGING], capture_output=True, text=True, timeout=WAIT_S
    )
    assert hanging.returncode == 1, hanging.stderr
    assert "Timeout" in hanging.stderr
    assert '"<string>", line 10 in <module>' in hanging.stderr


def wait_for_text(path: Path, text: str) -> None:
    deadline_s = time.monotonic() + WAIT_S
    while not path.exists() or text not in path.read_text():
        assert time.monotonic() < deadline_s, f"{text} is not in {path.name}"
        time.sleep(0.02)
