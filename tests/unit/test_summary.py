"""The summary of a grid, against numbers worked out by hand."""

from __future__ import annotations

import pytest

from common.api import EvaluationRequest, StageCounts
from common.messages import Distribution, StagesReached
from services.control.summary import TrialFacts, measurements_of, summarise
from tests.control_nodes import make_result


def facts(index, status, *, robot="panda", **measured):
    return TrialFacts("lid", robot, "expert", index, status, **measured)


def measured(**changes):
    spread = Distribution(median=0.01, p95=0.02, p99=0.03, largest=0.04)
    return measurements_of(make_result().model_copy(update={"solve_time_s": spread, **changes}))


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
        facts(0, "success", **measured(sim_time_s=6.0, wall_time_s=1.0, trace_sha256="a" * 64)),
        facts(2, "aborted"),
        facts(1, "failure", **measured(sim_time_s=4.0, wall_time_s=1.5, trace_sha256="b" * 64)),
        facts(3, "running"),
    ]
    panda, spot = summarise(request_, trials)
    assert (panda.done, panda.successes, panda.failures, panda.aborted) == (3, 1, 1, 1)
    assert panda.success_rate == pytest.approx(1 / 3)
    assert panda.real_time_factor == pytest.approx(4.0)
    assert panda.trace_sha256 == ["a" * 64, "b" * 64, None, None]
    assert spot.done == 0


def test_each_measurement_is_summarised_in_its_own_way(request_):
    def spread(median, p95, p99):
        return Distribution(median=median, p95=p95, p99=p99, largest=1.0)

    trials = [
        facts(
            0,
            "success",
            **measured(
                hand_error_m=spread(0.01, 0.02, 0.9),
                hand_scaling_mean=1.0,
                hand_scaling_least=0.8,
                limited_share=0.2,
                solver_failures=2,
                solve_time_s=spread(1e-4, 0.9, 3e-4),
            ),
        ),
        facts(
            1,
            "failure",
            **measured(
                hand_error_m=spread(0.03, 0.06, 0.9),
                hand_scaling_mean=0.9,
                hand_scaling_least=0.0,
                limited_share=0.5,
                solver_failures=3,
                solve_time_s=spread(2e-4, 0.9, 5e-4),
            ),
        ),
        facts(2, "aborted"),
    ]
    panda, spot = summarise(request_, trials)
    assert panda.median_hand_error_m == pytest.approx(0.02)
    assert panda.p95_hand_error_m == pytest.approx(0.04)
    assert panda.mean_hand_scaling == pytest.approx(0.95)
    assert panda.least_hand_scaling == 0.0
    assert panda.limited_share == pytest.approx(0.35)
    assert panda.solver_failures == 5
    assert panda.median_solve_time_s == pytest.approx(1.5e-4)
    assert panda.p99_solve_time_s == pytest.approx(4e-4)
    nothing = (spot.mean_hand_scaling, spot.least_hand_scaling, spot.limited_share)
    assert (*nothing, spot.median_solve_time_s, spot.p99_solve_time_s) == (None,) * 5
    assert spot.solver_failures == 0


def test_every_trial_with_a_result_counts_in_the_stages_it_reached(request_):
    def reached(*names):
        every = ("grasped", "lifted", "placed", "released")
        return StagesReached(**{name: name in names for name in every})

    trials = [
        facts(0, "success", **measured()),
        facts(1, "failure", **measured(stages=reached("grasped", "lifted"))),
        facts(2, "failure", **measured(stages=reached("grasped"))),
        facts(3, "aborted"),
    ]
    panda, spot = summarise(request_, trials)
    assert panda.stages == StageCounts(grasped=3, lifted=2, placed=1, released=1)
    assert spot.stages == StageCounts(grasped=0, lifted=0, placed=0, released=0)


def test_cancelled_trials_are_not_done(request_):
    panda, _ = summarise(request_, [facts(0, "cancelled"), facts(1, "success")])
    assert (panda.done, panda.success_rate) == (1, 1.0)
