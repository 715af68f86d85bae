"""Shards that are merged give what a single run gives, bit for bit where nothing is timed."""

from __future__ import annotations

import dataclasses
import importlib.util
import io
import json
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from client import main as cli
from client.offline import run_in_process
from client.progress import LineProgress
from client.record import EvaluationRecord, to_json
from client.report import render_report
from client.sharding import header, workers
from client.sharding.errors import ShardFailed
from client.sharding.merge import merge_shards
from client.sharding.run import ShardOrder, ShardSummary, run_shard
from client.sharding.shard import Shard
from client.sharding.workers import run_workers
from common.api import EvaluationRequest, Trial
from tests.client_samples import WHEN

pytestmark = pytest.mark.processes

REQUEST = EvaluationRequest(
    tasks=["lid"], robots=["abstract"], policies=["expert", "legato-lid"], trials=2, seed=3
)
SHORT = EvaluationRequest(
    tasks=["lid"], robots=["abstract"], policies=["expert"], trials=2, pictures=False
)


class StopAfter(LineProgress):
    """Stops an evaluation when so many trials have ended."""

    def __init__(self, trials: int, stop: threading.Event) -> None:
        super().__init__(io.StringIO())
        self._trials = trials
        self._stop = stop

    def update(self, event):
        super().update(event)
        if event.evaluation.trials_done >= self._trials:
            self._stop.set()


def order_of(folder: Path, number: int, count: int, request=REQUEST) -> ShardOrder:
    return ShardOrder(request=request, shard=Shard(number, count), folder=folder, checkpoints={})


def run(order: ShardOrder, *, most: int = 100) -> ShardSummary:
    stop = threading.Event()
    return run_shard(order, open_display=lambda: StopAfter(most, stop), stop=stop)


def untimed_trial(trial: Trial) -> Trial:
    """The trial without what a clock has measured."""
    result = trial.result
    assert result is not None
    measured = ("wall_time_s", "solve_time_s", "inference_s", "wall_times")
    attempts = [
        attempt.model_copy(update={"epoch": 0, "started_at": WHEN, "finished_at": WHEN})
        for attempt in trial.attempts
    ]
    same = result.model_copy(update=dict.fromkeys(measured))
    return trial.model_copy(update={"evaluation": "e", "attempts": attempts, "result": same})


def untimed(record: EvaluationRecord) -> EvaluationRecord:
    """The record without what a clock has measured."""
    timed = ("median_solve_time_s", "p99_solve_time_s", "real_time_factor")
    cells = [cell.model_copy(update=dict.fromkeys(timed)) for cell in record.evaluation.cells]
    changes = {"id": "e", "created_at": WHEN, "finished_at": WHEN, "cells": cells}
    return dataclasses.replace(
        record,
        evaluation=record.evaluation.model_copy(update=changes),
        trials=[untimed_trial(trial) for trial in record.trials],
    )


@pytest.mark.long
def test_three_shards_are_one_run(tmp_path: Path, monkeypatch):
    """A learned policy too, shards in another order; one is stopped, and goes on."""
    # Whoever edits the code meanwhile would be found out.
    monkeypatch.setattr(header, "hash_code", lambda: "ab" * 32)
    stop = threading.Event()
    single = run_in_process(REQUEST, progress=LineProgress(io.StringIO()), stop=stop)
    stopped = run(order_of(tmp_path, 2, 3), most=1)
    assert (stopped.trials, stopped.before, stopped.done) == (2, 0, 1)
    for number in (2, 0, 1):
        assert run(order_of(tmp_path, number, 3)).done == len(Shard(number, 3).trials(4))
    again = run(order_of(tmp_path, 2, 3))
    assert (again.before, again.done) == (2, 2)

    one, merged = untimed(single), untimed(merge_shards(tmp_path))
    assert merged.trials == one.trials
    assert merged.evaluation == one.evaluation
    assert json.dumps(to_json(merged)) == json.dumps(to_json(one))
    assert render_report(merged, command="c") == render_report(one, command="c")
    assert "data:image/png" in render_report(merged, command="c")


@pytest.mark.long
def test_workers_run_all_shards_and_go_on(tmp_path: Path, capsys):
    stop = threading.Event()
    stop.set()
    orders = [order_of(tmp_path, number, 2, SHORT) for number in range(2)]
    assert not run_workers(orders, stop=stop)
    grid = ["eval", "--robot", "abstract", "--trials", "2", "--out", str(tmp_path)]
    assert cli.run([*grid, "--workers", "2", "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    single = run_in_process(SHORT, progress=LineProgress(io.StringIO()), stop=threading.Event())
    assert shown["cells"][0]["trace_sha256"] == single.evaluation.cells[0].trace_sha256
    assert cli.run([*grid, "--shard", "1/2"]) == 0
    assert "1 of 1 trials; it was complete, nothing was run" in capsys.readouterr().out


@pytest.mark.long
@pytest.mark.skipif(importlib.util.find_spec("ray") is None, reason="the extra ray is not there")
def test_shards_on_ray_are_one_run(tmp_path: Path):
    """In a process of its own: Ray leaves threads and warnings behind."""
    grid = ["eval", "--robot", "abstract", "--trials", "2", "--out", str(tmp_path / "shards")]
    ended = subprocess.run(
        [sys.executable, "-m", "client.main", *grid, "--workers", "2", "--ray", "--json"],
        env={name: value for name, value in os.environ.items() if name != "RAY_ADDRESS"},
        capture_output=True,
        text=True,
        timeout=600,
        check=True,
    )
    shown = json.loads(ended.stdout.splitlines()[-1])
    single = run_in_process(SHORT, progress=LineProgress(io.StringIO()), stop=threading.Event())
    assert shown["cells"][0]["trace_sha256"] == single.evaluation.cells[0].trace_sha256


def test_without_ray_the_extra_is_named(tmp_path: Path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "ray", None)
    assert cli.run(["eval", "--workers", "2", "--ray", "--out", str(tmp_path)]) == 2
    assert "pip install 'legato[ray]'" in capsys.readouterr().err


def test_an_interrupted_shard_says_how_to_go_on(tmp_path: Path, monkeypatch, capsys):
    def interrupted(order, *, open_display, stop):
        return ShardSummary(order.folder / "f", trials=3, before=1, done=2)

    monkeypatch.setattr("client.verbs.shards.run_shard", interrupted)
    assert cli.run(["eval", "--shard", "0/2", "--out", str(tmp_path)]) == 130
    shown = capsys.readouterr()
    assert "shard 0/2, 2 of 3 trials, 1 of them from before" in shown.out
    assert "run the same command again to go on" in shown.err


def test_a_worker_that_fails_is_named_and_stops_the_others(tmp_path: Path, capfd, monkeypatch):
    unknown = SHORT.model_copy(update={"policies": ["nobody"]})
    with pytest.raises(ShardFailed, match="shard 0/1 has ended: exit code 2"):
        run_workers([order_of(tmp_path, 0, 1, unknown)], stop=threading.Event())
    assert 'shard 0/1: E-UNKNOWN-NAME  no policy "nobody"' in capfd.readouterr().err
    code = "import os, sys; sys.stdin.read() if '\"number\":1' in sys.argv[1] else os.abort()"
    monkeypatch.setattr(workers, "COMMAND", (sys.executable, "-c", code))
    with pytest.raises(ShardFailed, match="shard 0/2 has ended: killed by signal 6"):
        run_workers(
            [order_of(tmp_path, number, 2, SHORT) for number in range(2)], stop=threading.Event()
        )
