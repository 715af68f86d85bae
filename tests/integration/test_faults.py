"""Processes are killed in the middle of a trial: what is reported must stay true."""

from __future__ import annotations

import os
import signal
import time
from datetime import datetime
from pathlib import Path

import pytest

from common.api import EvaluationRequest, Trial
from tests.deployments import kill, running, wait_for_running_trial, wait_until_done

pytestmark = pytest.mark.processes

HANG_S = 3.0
"""Longer than the usual lease, and than the usual wait for an answer."""

VICTIMS = {
    "sim-0": "sim sim-0",
    "retarget-panda": "retarget retarget-panda",
    "gripper": "gripper gripper",
    "policy": "policy policy",
    "router": "router",
    "control": "control plane",
}


def request(trials: int) -> EvaluationRequest:
    return EvaluationRequest(
        tasks=["lid"], robots=["panda"], policy="expert", trials=trials, seed=3, pictures=False
    )


def seconds(earlier: datetime, later: datetime) -> float:
    return (later - earlier).total_seconds()


def test_killing_any_one_process_aborts_names_retries_and_counts_truthfully(tmp_path: Path):
    """One system, six evaluations of two trials; each loses another process in its first trial."""
    with running(tmp_path, robots=("panda",)) as (_, supervisor, client):
        stored: dict[str, list[Trial]] = {}
        for victim, named in VICTIMS.items():
            evaluation = client.submit(request(2)).id
            trial = wait_for_running_trial(client, evaluation)
            time.sleep(0.3)
            killed_at = datetime.now().astimezone()
            killed_pid = kill(supervisor, victim)
            done = wait_until_done(client, evaluation)
            trials = client.trials(evaluation)

            (cell,) = done.cells
            assert done.status == "done", victim
            assert (cell.successes, cell.failures, cell.aborted) == (2, 0, 0), victim
            hit = next(t for t in trials if t.id == trial.id)
            assert [a.outcome for a in hit.attempts] == ["aborted", "success"], victim
            assert named in hit.attempts[0].reason, victim
            assert supervisor.pids[victim] != killed_pid
            if victim != "control":
                # A control plane that is dead writes the abort when it is back.
                assert hit.attempts[0].finished_at is not None
                assert seconds(killed_at, hit.attempts[0].finished_at) < 2.0, victim
            (other,) = [t for t in trials if t.id != trial.id]
            assert len(other.attempts) == 1, victim
            stored[evaluation] = trials
        # Nothing that was stored has changed since, not even by the death of the control plane.
        for evaluation, trials in stored.items():
            assert client.trials(evaluation) == trials


def test_a_trace_depends_neither_on_a_retry_nor_on_a_hang_within_the_lease(tmp_path: Path):
    with running(tmp_path, robots=("panda",), lease_s=20.0) as (_, supervisor, client):
        clean = wait_until_done(client, client.submit(request(1)).id)
        disturbed = client.submit(request(1)).id
        wait_for_running_trial(client, disturbed)
        kill(supervisor, "retarget-panda")
        again = wait_until_done(client, disturbed)
        assert clean.cells[0].trace_sha256 == again.cells[0].trace_sha256
        assert client.trials(disturbed)[0].attempts[0].outcome == "aborted"

        halting = client.submit(request(1)).id
        wait_for_running_trial(client, halting)
        for node in ("policy", "retarget-panda"):
            os.kill(supervisor.pids[node], signal.SIGSTOP)
            time.sleep(HANG_S)
            os.kill(supervisor.pids[node], signal.SIGCONT)
        waited = wait_until_done(client, halting)
        assert [len(trial.attempts) for trial in client.trials(halting)] == [1]
        assert clean.cells[0].trace_sha256 == waited.cells[0].trace_sha256
