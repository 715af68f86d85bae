from __future__ import annotations

import pytest

from client.tap import QueueTap, RateTap, compute_rate, open_tap
from common.bus import Bus, BusSettings, Received, open_session
from common.errors import RouterUnreachable
from common.messages import EpisodeAbort, Header
from common.topics import topic_named, topic_of

TOPIC = topic_named("robot/state")


def received(number: int) -> Received:
    return Received(TOPIC, "cell/sim-0/robot/state", "", bytes([number]))


def test_rate_of_regular_messages():
    rate = compute_rate("k", [0, 10_000_000, 30_000_000], duration_s=1.0)
    assert rate.count == 3
    assert rate.rate_hz == pytest.approx(2 / 0.03)
    assert (rate.shortest_s, rate.longest_s) == pytest.approx((0.01, 0.02))


def test_rate_of_one_message_counts_over_the_whole_time():
    rate = compute_rate("k", [5], duration_s=2.0)
    assert (rate.rate_hz, rate.shortest_s, rate.longest_s) == (0.5, None, None)


def test_a_slow_reader_loses_the_newest_and_is_told():
    tap = QueueTap()
    for number in range(1002):
        tap.put(received(number % 256))
    assert tap.lost == 2
    first = tap.take(0.0)
    assert first is not None
    assert first.payload == b"\x00"


def test_take_gives_up():
    assert QueueTap().take(0.0) is None


def test_taps_see_what_is_on_the_bus():
    settings = BusSettings(profile="in_process", namespace="test-tap")
    topic, rates, queue = topic_of(EpisodeAbort), RateTap(), QueueTap()
    with open_session(settings) as session, Bus(session) as bus:
        for tap in (rates, queue):
            bus.subscribe(topic, tap)
        for _ in range(2):
            message = EpisodeAbort(header=Header(cell="sim-0"), reason="test")
            bus.publish(message, owner="sim-0", mode="lockstep")
    (rate,) = rates.rates(topic, duration_s=1.0)
    assert (rate.key, rate.count) == ("cell/sim-0/episode/abort", 2)
    assert rates.rates(TOPIC, duration_s=1.0) == []
    taken = queue.take(0.0)
    assert taken is not None
    assert taken.key == "cell/sim-0/episode/abort"


def test_no_router_is_said_after_two_seconds():
    settings = BusSettings(endpoint="tcp/127.0.0.1:1")
    with pytest.raises(RouterUnreachable), open_tap(settings, RateTap(), [TOPIC]):
        pass
