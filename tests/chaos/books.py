"""Whether the books are right: what REST says, what the database holds, what was asked for."""

from __future__ import annotations

import contextlib
import sqlite3
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from client.api import LegatoClient
from common.aborts import Cause
from common.api import Evaluation, EvaluationRequest, Trial
from services.control.grid import trial_seed
from services.control.scheduler import MAX_ATTEMPTS
from tests.chaos.workload import ENDED


def check_evaluation(evaluation: Evaluation, trials: Sequence[Trial]) -> None:
    """One evaluation that has ended: everything asked for is there once, and has one end."""
    request = evaluation.request
    assert evaluation.status == "done"
    assert evaluation.trials_done == evaluation.trials_total == len(trials)
    asked = Counter((robot, index) for robot in request.robots for index in range(request.trials))
    assert Counter((trial.robot, trial.index) for trial in trials) == asked
    for trial in trials:
        check_trial(trial, request)
    counted = Counter({"success": 0, "failure": 0, "aborted": 0})
    for cell in evaluation.cells:
        counted.update(success=cell.successes, failure=cell.failures, aborted=cell.aborted)
    assert counted == Counter({"success": 0, "failure": 0, "aborted": 0}) + counted
    assert dict(counted) == {status: [t.status for t in trials].count(status) for status in ENDED}


def check_trial(trial: Trial, request: EvaluationRequest) -> None:
    """One trial: its seed, its end and the attempts that led to it."""
    assert trial.status in ENDED, trial
    assert trial.seed == trial_seed(request.seed, trial.index)
    assert trial.reason
    outcomes = [attempt.outcome for attempt in trial.attempts]
    assert [attempt.number for attempt in trial.attempts] == [*range(1, len(outcomes) + 1)]
    assert len(outcomes) <= MAX_ATTEMPTS
    assert all(attempt.reason and attempt.finished_at for attempt in trial.attempts), trial
    assert set(outcomes[:-1]) <= {"aborted"}
    for attempt in trial.attempts:
        if attempt.outcome == "aborted":
            assert_typed(attempt.reason)
    if trial.status == "aborted":
        assert trial.result is None
        assert_typed(trial.reason)
        assert set(outcomes) == {"aborted"}
    else:
        assert outcomes[-1] == trial.status
        assert trial.result is not None
        assert trial.result.outcome == trial.status


def assert_typed(reason: str) -> None:
    """A reason says its cause first."""
    cause, _, text = reason.partition(": ")
    assert cause in list(Cause)
    assert text


def check_all(
    client: LegatoClient, requests: Sequence[EvaluationRequest], data: Path
) -> list[Trial]:
    """Every evaluation over REST and in the database; give back the trials.

    Args:
        client: Of the control plane.
        requests: What was asked for, told apart by their seeds.
        data: Folder of the database.
    """
    evaluations = client.evaluations()
    assert sorted(each.request.seed for each in evaluations) == sorted(r.seed for r in requests)
    trials: list[Trial] = []
    for evaluation in evaluations:
        found = client.trials(evaluation.id)
        check_evaluation(evaluation, found)
        trials += found
    epochs = [attempt.epoch for trial in trials for attempt in trial.attempts]
    assert len(set(epochs)) == len(epochs)
    check_database(data, trials)
    return trials


def check_database(data: Path, trials: Sequence[Trial]) -> None:
    """The rows say what REST says, and nothing is left open."""
    with contextlib.closing(sqlite3.connect(data / "legato.db")) as connection:
        rows = connection.execute("SELECT evaluation, id, status FROM trials").fetchall()
        attempts = connection.execute("SELECT evaluation, trial, outcome FROM attempts").fetchall()
        (open_count,) = connection.execute(
            "SELECT count(*) FROM evaluations WHERE status = 'running'"
        ).fetchone()
    assert sorted(rows) == sorted((t.evaluation, t.id, t.status) for t in trials)
    assert Counter(attempts) == Counter(
        (trial.evaluation, trial.id, attempt.outcome)
        for trial in trials
        for attempt in trial.attempts
    )
    assert open_count == 0
