"""Each trial of a recording differs from the nominal one in its own way, by its seed."""

import pytest

from client.commands import DemoRecord
from client.recording.plan import make_plan
from client.recording.variation import Variation
from common.api import EvaluationRequest
from common.errors import InvalidValue

REQUEST = EvaluationRequest(tasks=["lid"], robots=["abstract"], policy="expert", trials=1)


def test_without_variation_a_trial_is_the_nominal_one():
    assert Variation().apply(REQUEST, seed=5) == REQUEST


def test_trials_draw_their_own_values_within_the_range():
    variation = Variation(tracking_lag_s=0.12, action_latency_s=0.1, randomise_camera=True)
    drawn = [variation.apply(REQUEST, seed=seed) for seed in range(200)]
    assert drawn == [variation.apply(REQUEST, seed=seed) for seed in range(200)]
    lags = [each.tracking_lag_s for each in drawn]
    latencies = {round(1000 * each.action_latency_s) for each in drawn}
    assert 0.11 < max(lags) <= 0.12
    assert latencies == set(range(0, 101, 10))


def test_each_kind_of_variation_is_left_out_of_half_of_the_trials():
    variation = Variation(tracking_lag_s=0.12, action_latency_s=0.1, randomise_camera=True)
    drawn = [variation.apply(REQUEST, seed=seed) for seed in range(400)]
    obeys = [each.tracking_lag_s == 0.0 for each in drawn]
    # A twentieth of the latencies that are drawn are rounded to none.
    at_once = [each.action_latency_s == 0.0 for each in drawn]
    clean = [not each.randomise_camera for each in drawn]
    for left_out in (obeys, at_once, clean):
        assert 160 < sum(left_out) < 250
    assert 25 < sum(all(each) for each in zip(obeys, at_once, clean, strict=True)) < 80


def test_the_plan_takes_it_from_the_command_line():
    plan = make_plan(DemoRecord(episodes=1, tracking_lag_ms=80.0, randomise_camera=True))
    assert plan.variation == Variation(tracking_lag_s=0.08, randomise_camera=True)
    assert plan.describe().recording["variation"] == plan.variation.model_dump()


def test_a_lag_out_of_range_is_refused():
    with pytest.raises(InvalidValue, match="--tracking-lag-ms"):
        make_plan(DemoRecord(episodes=1, tracking_lag_ms=-1.0))
