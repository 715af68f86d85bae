"""The summary of a grid, against numbers worked out by hand."""

from __future__ import annotations

import pytest

from common.api import EvaluationRequest
from services.control.summary import TrialFacts, summarise


def facts(index, status, *, robot="panda", median=None, p95=None, sim=None, wall=None, sha=None):
    return TrialFacts("lid", robot, "expert", index, status, median, p95, sim, wall, sha)


@pytest.fixture
def request_():
    return EvaluationRequest(tasks=["lid"], robots=["panda", "spot"], policy="expert", trials=4)


def test_nothing_is_known_before_the_first_trial(request_):
    cells = summarise(request_, [])
    assert [(c.robot, c.trials, c.done) for c in cells] == [("panda", 4, 0), ("spot", 4, 0)]
    assert all(c.success_rate is None and c.interval95 == (0.0, 1.0) for c in cells)
    assert all(c.trace_sha256 == [None] * 4 for c in cells)


def test_aborted_trials_stay_in_the_count(request_):
    trials = [
        facts(0, "success", median=0.01, p95=0.02, sim=6.0, wall=1.0, sha="a" * 64),
        facts(2, "aborted"),
        facts(1, "failure", median=0.03, p95=0.06, sim=4.0, wall=1.5, sha="b" * 64),
        facts(3, "running"),
    ]
    panda, spot = summarise(request_, trials)
    assert (panda.done, panda.successes, panda.failures, panda.aborted) == (3, 1, 1, 1)
    assert panda.success_rate == pytest.approx(1 / 3)
    assert panda.median_hand_error_m == pytest.approx(0.02)
    assert panda.p95_hand_error_m == pytest.approx(0.04)
    assert panda.real_time_factor == pytest.approx(4.0)
    assert panda.trace_sha256 == ["a" * 64, "b" * 64, None, None]
    assert spot.done == 0


def test_cancelled_trials_are_not_done(request_):
    panda, _ = summarise(request_, [facts(0, "cancelled"), facts(1, "success")])
    assert (panda.done, panda.success_rate) == (1, 1.0)
