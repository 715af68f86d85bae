"""Which trials are run and which are stored does not depend on who is faster."""

from __future__ import annotations

import random

import pytest

from client.recording.errors import YieldTooLow
from client.recording.ledger import JUDGED_AFTER, Ledger
from client.recording.report import TrialReport


def report(trial: int, outcome: str = "success") -> TrialReport:
    return TrialReport(trial=trial, seed=trial, outcome=outcome, reason=f"reason {trial}")


def run(wanted: int, outcomes, *, workers: int, seed: int = 0, **start) -> tuple[Ledger, list[int]]:
    """Run a recording whose workers finish in a random order; give what was handed on."""
    ledger, choose = Ledger(wanted=wanted, **start), random.Random(seed)
    running, taken, handed_out = [], [], []
    while not ledger.done:
        while len(running) < workers and (trial := ledger.hand_out()) is not None:
            running.append(trial)
            handed_out.append(trial)
        trial = running.pop(choose.randrange(len(running)))
        ledger.settle(report(trial, outcomes(trial)))
        taken += [ready.trial for ready in ledger.take_ready()]
    assert not running, "a trial was run for nothing"
    assert taken == handed_out
    return ledger, taken


def often(trial: int) -> str:
    return "failure" if trial % 3 == 1 else "success"


@pytest.mark.parametrize("workers", [1, 2, 5, 16])
@pytest.mark.parametrize("seed", range(5))
def test_the_same_trials_for_any_number_of_workers(workers, seed):
    ledger, taken = run(12, often, workers=workers, seed=seed)
    assert taken == list(range(18))
    assert (ledger.successes, ledger.trials, ledger.aborted) == (12, 18, 0)


def test_it_goes_on_where_it_has_stopped():
    ledger, taken = run(12, often, workers=3, trials=7, successes=5)
    assert taken == list(range(7, 18))
    assert ledger.successes == 12


def test_nothing_is_to_be_done_when_enough_are_there():
    ledger = Ledger(wanted=3, trials=4, successes=3)
    assert ledger.done
    assert ledger.hand_out() is None


def test_a_report_waits_for_those_before_it():
    ledger = Ledger(wanted=3)
    assert [ledger.hand_out() for _ in range(4)] == [0, 1, 2, None]
    ledger.settle(report(2))
    assert list(ledger.take_ready()) == []
    ledger.settle(report(0))
    assert [ready.trial for ready in ledger.take_ready()] == [0]
    ledger.settle(report(1, "aborted"))
    assert [ready.trial for ready in ledger.take_ready()] == [1, 2]
    assert (ledger.aborted, ledger.last_reason) == (1, "reason 1")
    assert [ledger.hand_out() for _ in range(2)] == [3, None]


@pytest.mark.parametrize("workers", [1, 4])
def test_without_a_success_in_the_first_twenty_it_gives_up(workers):
    with pytest.raises(YieldTooLow, match=r"0 of 20 trials succeeded \(last failure: reason 19\)"):
        run(100, lambda trial: "failure", workers=workers)


def test_one_in_twenty_is_enough():
    rare = lambda trial: "success" if trial % JUDGED_AFTER == 0 else "failure"  # noqa: E731
    ledger, _ = run(5, rare, workers=2)
    assert ledger.trials == 4 * JUDGED_AFTER + 1
    with pytest.raises(YieldTooLow, match="1 of 21 trials"):
        run(5, lambda trial: "success" if trial == 0 else "failure", workers=2)
