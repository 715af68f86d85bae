"""SIGTERM in the middle of an episode: every process closes its session and ends with 0."""

from __future__ import annotations

import json
import os
import signal
import time
from pathlib import Path

import pytest

from client.supervisor import Supervisor
from common.api import EvaluationRequest
from tests.deployments import running, wait_for_running_trial

pytestmark = pytest.mark.processes

NODES = ("sim-0", "retarget-abstract", "gripper", "policy", "router", "control")
"""The router before the control plane, which is asked whether a trial runs."""

WAIT_S = 60.0
"""Bound of every wait; reached only by a test that fails."""


def terminate(supervisor: Supervisor, node: str) -> None:
    """SIGTERM to one process; return once another runs in its place."""
    pid = supervisor.pids[node]
    os.kill(pid, signal.SIGTERM)
    deadline_s = time.monotonic() + WAIT_S
    while supervisor.pids.get(node, pid) == pid:
        assert time.monotonic() < deadline_s, f"{node} does not stop"
        time.sleep(0.02)


def test_every_process_stops_on_sigterm_while_a_trial_runs(tmp_path: Path, caplog):
    request = EvaluationRequest(
        tasks=["lid"], robots=["abstract"], policy="expert", trials=100, pictures=False
    )
    with running(tmp_path, robots=("abstract",)) as (deployment, supervisor, client):
        evaluation = client.submit(request).id
        for node in NODES:
            wait_for_running_trial(client, evaluation)
            terminate(supervisor, node)
        died = [(line.node, line.exit_code) for line in caplog.records if line.message == "died"]
        assert died == [(node, 0) for node in NODES]
        for node in NODES:
            lines = (deployment.logs / f"{node}.log").read_text().splitlines()
            events = [json.loads(line)["event"] for line in lines if line.startswith("{")]
            # Written by the block that closes the session when it is left.
            assert "stopping" in events, node
