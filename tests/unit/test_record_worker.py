"""What a worker makes of what recorder and scheduler tell it."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np
import pytest

from client.recording.parts import list_parts, read_part
from client.recording.report import WorkerOrder
from client.recording.worker import Demonstrator
from common.datasets import EpisodeRows
from common.messages import LocalMessage
from services.control.events import EvaluationEnded, SubmitEvaluation, TrialEnded
from services.control.grid import trial_seed
from services.recorder.events import EpisodeIncomplete, RecordedEpisode
from tests.client_samples import make_result
from tests.unit.test_recorder import configure

ROWS = EpisodeRows({"action": np.zeros((3, 6))})


class FakeServices:
    """Ends every trial at once, in the way that is asked for."""

    def __init__(self, demonstrator: Demonstrator, outcome: str, recorded: LocalMessage | None):
        self._demonstrator = demonstrator
        self._outcome = outcome
        self._recorded = recorded
        self.submitted: SubmitEvaluation | None = None

    def tell(self, event: SubmitEvaluation) -> None:
        self.submitted = event
        (trial,) = event.trials
        if self._recorded is not None:
            self._demonstrator.take_recorder(self._recorded)
        if self._outcome != "none":
            result = None if self._outcome == "aborted" else make_result(outcome=self._outcome)
            self._demonstrator.take_control(TrialEnded(trial, self._outcome, "why", result))
            self._demonstrator.take_control(EvaluationEnded(event.evaluation, "done"))

    def run(self, *, until: Callable[[], bool]) -> None:
        assert until()


@pytest.fixture
def run(tmp_path):
    def call(outcome, *, recorded: LocalMessage | None = None, keep_failed=False, stopped=False):
        order = WorkerOrder(
            task="lid",
            robot="abstract",
            camera="t265",
            policy="expert",
            seed=4,
            keep_failed=keep_failed,
            parts=str(tmp_path),
        )
        stop = threading.Event()
        if stopped:
            stop.set()
        demonstrator = Demonstrator(order, stop)
        services = FakeServices(demonstrator, outcome, recorded)
        report = demonstrator.run(9, services)
        assert services.submitted is not None
        assert services.submitted.trials[0].seed == trial_seed(4, 9)
        return report

    return call


def episode(outcome: str) -> RecordedEpisode:
    return RecordedEpisode(configure(), make_result(outcome=outcome), ROWS, 2)


def test_a_success_is_stored_with_what_is_known_of_it(run, tmp_path):
    report = run("success", recorded=episode("success"))
    assert (report.outcome, report.stored, report.seed) == ("success", True, trial_seed(4, 9))
    rows, about = read_part(tmp_path, 9)
    assert np.array_equal(rows.columns["action"], ROWS.columns["action"])
    assert (about.trial, about.seed, about.outcome) == (9, 5, "success")
    assert about.details["idle_rows_dropped"] == 2
    assert "wall_time_s" not in about.details


def test_a_failure_is_stored_only_when_asked_for(run, tmp_path):
    assert not run("failure", recorded=episode("failure")).stored
    assert list_parts(tmp_path) == set()
    assert run("failure", recorded=episode("failure"), keep_failed=True).stored
    assert list_parts(tmp_path) == {9}


def test_an_aborted_trial_is_not_stored(run, tmp_path):
    report = run("aborted", keep_failed=True)
    assert (report.outcome, report.reason, report.stored) == ("aborted", "why", False)
    assert list_parts(tmp_path) == set()


def test_a_recording_with_a_gap_counts_as_aborted(run, tmp_path):
    report = run("success", recorded=EpisodeIncomplete(configure(), "frame 3 has no truth"))
    assert (report.outcome, report.stored) == ("aborted", False)
    assert report.reason == "not recorded: frame 3 has no truth"
    assert list_parts(tmp_path) == set()


def test_a_trial_that_is_stopped_has_no_report(run):
    assert run("none", stopped=True) is None
