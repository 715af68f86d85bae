from __future__ import annotations

import io

from client.progress import LineProgress, LiveProgress, describe_trial, open_progress
from common.api import ProgressEvent
from tests.client_samples import make_cell, make_evaluation, make_trial


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_the_stream_decides():
    assert isinstance(open_progress(io.StringIO()), LineProgress)
    assert isinstance(open_progress(Terminal()), LiveProgress)


def test_one_line_per_finished_trial():
    stream = io.StringIO()
    with LineProgress(stream) as progress:
        for status in ("running", "success", "success"):
            trial = make_trial(3, status=status)
            progress.update(ProgressEvent(evaluation=make_evaluation(trials_done=1), trial=trial))
    assert stream.getvalue() == (
        "   1/4  lid panda expert  trial 0  success  8.4 s  hand error p95 4.0 mm  10.0x\n"
    )


def test_what_is_missing_is_told_once():
    stream = io.StringIO()
    waiting = ProgressEvent(evaluation=make_evaluation(waiting_for=["retarget for panda"]))
    with LineProgress(stream) as progress:
        progress.update(waiting)
        progress.update(waiting)
    assert stream.getvalue() == "waiting for retarget for panda\n"


def test_a_failure_says_why():
    assert describe_trial(make_trial(status="failure")).endswith("dropped the lid")
    assert describe_trial(make_trial(status="aborted")).endswith("aborted  panda left")


def test_the_live_display_ends_with_the_last_state(monkeypatch):
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setenv("TERM", "xterm")
    stream = Terminal()
    event = ProgressEvent(
        evaluation=make_evaluation(
            cells=[make_cell(done=1)], waiting_for=["sim"], status="running", trials_done=1
        ),
        trial=make_trial(status="failure"),
    )
    with LiveProgress(stream) as progress:
        progress.update(event)
    shown = stream.getvalue()
    for expected in ("█", "1/2", "50 %", "[10-90]", "1.2 / 4.7", "10.4x", "waiting for sim"):
        assert expected in shown, expected
    assert "last failure: lid panda expert" in shown
