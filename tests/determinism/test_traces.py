"""The same trial gives the same trace, bit for bit, in one process and over processes."""

from __future__ import annotations

import functools
import io
import threading
from pathlib import Path

import pytest

from client.offline import run_in_process
from client.progress import LineProgress
from common.api import EvaluationRequest
from common.robots import list_robots
from tests.deployments import running, wait_until_done

pytestmark = pytest.mark.processes

ROBOTS = ["abstract", "panda"]
"""Enough where the robot does not matter."""


def request(**changes: object) -> EvaluationRequest:
    fields: dict[str, object] = {
        "tasks": ["lid"],
        "robots": ROBOTS,
        "policy": "expert",
        "trials": 1,
        "seed": 7,
        "pictures": False,
    }
    return EvaluationRequest.model_validate(fields | changes)


def traces_in_process(**changes: object) -> dict[str, list[str | None]]:
    """Everything in this process, where hundreds of tests have run before."""
    record = run_in_process(
        request(**changes), progress=LineProgress(io.StringIO()), stop=threading.Event()
    )
    return {cell.robot: cell.trace_sha256 for cell in record.evaluation.cells}


@functools.cache
def traces_of_every_robot(task: str = "lid") -> dict[str, list[str | None]]:
    """What the others are compared with, run once."""
    return traces_in_process(tasks=[task], robots=list_robots())


@pytest.mark.parametrize(
    "task", ["lid", *(pytest.param(task, marks=pytest.mark.long) for task in ("cup", "ladle"))]
)
def test_processes_and_one_process_agree_bit_for_bit(tmp_path: Path, task: str):
    """Every robot: each has a retargeter process of its own."""
    robots = list_robots()
    inline = traces_of_every_robot(task)
    with running(tmp_path, robots=tuple(robots)) as (_, _, client):
        asked = request(tasks=[task], robots=robots)
        evaluation = wait_until_done(client, client.submit(asked).id)
    over_processes = {cell.robot: cell.trace_sha256 for cell in evaluation.cells}
    assert set(over_processes) == set(robots)
    for robot in robots:
        assert [len(trace or "") for trace in inline[robot]] == [64]
        assert inline[robot] == over_processes[robot]


def test_a_trial_does_not_depend_on_what_ran_before():
    """Other robots and trials before it, pictures on: the first trials are the same."""
    one = traces_of_every_robot()
    other = traces_in_process(trials=2, robots=ROBOTS[::-1], pictures=True)
    for robot in ROBOTS:
        assert other[robot][0] == one[robot][0]
    assert other["abstract"][0] != other["abstract"][1]


def test_latency_changes_the_trace_and_repeats():
    late = traces_in_process(robots=["abstract"], action_latency_s=0.05)
    assert late == traces_in_process(robots=["abstract"], action_latency_s=0.05)
    assert late["abstract"] != traces_of_every_robot()["abstract"]


def test_another_seed_is_another_trace():
    other = traces_in_process(robots=["abstract"], seed=8)
    assert other["abstract"] != traces_of_every_robot()["abstract"]
