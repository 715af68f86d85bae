"""Token buckets on a clock of the test."""

from __future__ import annotations

import pytest

from services.control.rate_limit import RateLimit


class Clock:
    now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock():
    return Clock()


def test_a_burst_then_the_rate(clock):
    limit = RateLimit(rate_hz=2, burst=3, now_s=clock)
    assert [limit.take("a") for _ in range(3)] == [0, 0, 0]
    assert limit.take("a") == 0.5
    clock.now_s += 0.25
    assert limit.take("a") == 0.25
    clock.now_s += 0.25
    assert limit.take("a") == 0
    assert limit.take("a") == 0.5


def test_a_pause_earns_no_more_than_a_burst(clock):
    limit = RateLimit(rate_hz=2, burst=3, now_s=clock)
    limit.take("a")
    clock.now_s += 1e6
    assert [limit.take("a") for _ in range(4)] == [0, 0, 0, 0.5]


def test_callers_do_not_share(clock):
    limit = RateLimit(rate_hz=1, burst=1, now_s=clock)
    assert limit.take("a") == 0
    assert limit.take("a") == 1
    assert limit.take("b") == 0


def test_memory_is_bounded_and_who_calls_is_not_forgotten(clock):
    limit = RateLimit(rate_hz=1, burst=1, now_s=clock)
    for number in range(5000):
        limit.take("busy")
        limit.take(f"address {number}")
    assert limit.take("busy") == 1
    assert len(limit._buckets) <= 1025
    assert limit.take("address 0") == 0
