"""A learned policy gives the same trace in one process and over processes, loaded over REST."""

from __future__ import annotations

import io
import threading
from pathlib import Path

import pytest

from client.offline import run_in_process
from client.progress import LineProgress
from common.api import Evaluation, EvaluationRequest
from services.policy.learning.checkpoint import load_checkpoint
from tests.checkpoints import write_checkpoint
from tests.deployments import running, wait_until_done

pytestmark = pytest.mark.processes

ROBOTS = ("abstract", "panda")


def request(**changes: object) -> EvaluationRequest:
    fields = {
        "tasks": ["lid"],
        "robots": list(ROBOTS),
        "policy": "small",
        "seed": 7,
        "trials": 1,
        "pictures": False,
    }
    return EvaluationRequest.model_validate(fields | changes)


def traces(evaluation: Evaluation) -> dict[str, list[str | None]]:
    return {cell.robot: cell.trace_sha256 for cell in evaluation.cells}


def run_here(folder: Path, **changes: object) -> Evaluation:
    return run_in_process(
        request(**changes),
        progress=LineProgress(io.StringIO()),
        stop=threading.Event(),
        checkpoints={"small": folder},
    ).evaluation


@pytest.mark.long
def test_processes_and_one_process_agree_bit_for_bit(tmp_path: Path):
    """Two cells share the policy process: its passes are filled in another way."""
    folder = write_checkpoint(tmp_path / "small")
    inline = run_here(folder)
    with running(tmp_path / "runs", robots=ROBOTS, cells=2) as (_, _, client):
        client.load_policy("small", str(folder))
        over_processes = wait_until_done(client, client.submit(request()).id)
    assert [cell.aborted for cell in over_processes.cells] == [0, 0]
    assert traces(over_processes) == traces(inline)
    assert all(len(trace or "") == 64 for each in traces(inline).values() for trace in each)
    for evaluation in (inline, over_processes):
        assert evaluation.versions["policy small"] == load_checkpoint(folder).sha256
