"""The learning rate over a run."""

import pytest

from services.policy.training.schedule import learning_rate


def rate(update: int) -> float:
    return learning_rate(update, peak=2.0, warmup=10, updates=110)


def test_it_rises_to_the_peak_and_falls_to_zero():
    assert rate(0) == pytest.approx(0.2)
    assert rate(9) == pytest.approx(2.0)
    assert rate(10) == pytest.approx(2.0)
    assert rate(60) == pytest.approx(1.0)
    assert rate(110) == pytest.approx(0.0, abs=1e-12)
    rates = [rate(update) for update in range(10, 111)]
    assert rates == sorted(rates, reverse=True)


def test_a_run_shorter_than_its_warm_up_rises_all_the_time():
    rates = [learning_rate(update, peak=1.0, warmup=50, updates=20) for update in range(20)]
    assert rates == sorted(rates)
    assert rates[-1] < 0.5
