"""The emergency stop through every process: REST, control plane, router, simulation."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import pytest

from client.api import LegatoClient
from common.api import CellInfo, EvaluationRequest, Mode
from tests.deployments import kill, running, wait_for_running_trial, wait_until_done

pytestmark = pytest.mark.processes


def request(mode: Mode) -> EvaluationRequest:
    return EvaluationRequest(
        tasks=["lid"], robots=["abstract"], policy="expert", trials=2, mode=mode, pictures=False
    )


def wait_for_cell(client: LegatoClient, condition: Callable[[CellInfo], bool]) -> CellInfo:
    deadline_s = time.monotonic() + 60.0
    while time.monotonic() < deadline_s:
        (cell,) = client.cells()
        if cell.alive and condition(cell):
            return cell
        time.sleep(0.05)
    raise AssertionError("waited in vain")


def wait_for_another(client: LegatoClient, killed_pid: int) -> None:
    deadline_s = time.monotonic() + 60.0
    while time.monotonic() < deadline_s:
        for service in client.services():
            if service.kind == "sim" and service.alive and service.pid not in (None, killed_pid):
                return
        time.sleep(0.05)
    raise AssertionError("the simulation was not started again")


def test_a_stop_ends_the_trial_in_both_modes_and_outlives_the_simulation(tmp_path: Path):
    with running(tmp_path, robots=("abstract",)) as (_, supervisor, client):
        for mode in ("lockstep", "realtime"):
            evaluation = client.submit(request(mode)).id
            trial = wait_for_running_trial(client, evaluation)
            wait_for_cell(client, lambda cell: cell.status == "running")
            (cell,) = client.stop(["sim-0"], reason="test")
            assert cell.emergency_stop
            ended, waiting = client.trials(evaluation)
            assert ended.id == trial.id
            assert (ended.status, len(ended.attempts)) == ("aborted", 1)
            assert (
                ended.reason
                == "emergency_stop: emergency stop of sim-0 by rest (test) (E-EMERGENCY-STOP)"
            )
            assert waiting.status == "pending"
            wait_for_cell(client, lambda cell: cell.status == "stopped")
            if mode == "lockstep":
                wait_for_another(client, kill(supervisor, "sim-0"))
                # A new process knows nothing of the stop: it is told.
                wait_for_cell(client, lambda cell: cell.emergency_stop)
                assert client.trials(evaluation)[1].status == "pending"
            (cell,) = client.reset()
            assert not cell.emergency_stop
            if mode == "lockstep":
                done = wait_until_done(client, evaluation)
                assert (done.cells[0].successes, done.cells[0].aborted) == (1, 1)
