import os
import random

import pytest

from benchmarks.soak.growth import measure_growth
from benchmarks.soak.latency import TOPICS, ArrivalTap, LatencyMatcher
from benchmarks.soak.processes import Sampler
from common.bus.codec import encode, encoding_of
from common.bus.inbox import Received
from common.messages import ActionStep, Header, PolicyAction, RobotCommand
from common.topics import key_of, topic_of

MS = 1_000_000
STEP = ActionStep(translation_m=[0.0] * 3, rotation_rad=[0.0] * 3, grasp=False)


def action(*, frame_ns: int, sent_ns: int, epoch: int = 1) -> PolicyAction:
    header = Header(cell="sim-0", epoch=epoch, t_mono_ns=sent_ns)
    return PolicyAction(
        header=header, for_step=0, request_t_mono_ns=frame_ns, steps=[STEP], inference_s=0.0
    )


def command(*, state_ns: int, epoch: int = 1) -> RobotCommand:
    return RobotCommand(
        header=Header(cell="sim-0", epoch=epoch),
        for_step=0,
        request_t_mono_ns=state_ns,
        positions=[0.0],
        velocities=[0.0],
    )


def samples(*, per_hour: float, minutes: float = 20.0) -> tuple[list[float], list[float]]:
    noise = random.Random(0)
    times_s = [1000.0 + second for second in range(int(60 * minutes))]
    grown = [per_hour * (time_s - times_s[0]) / 3600 for time_s in times_s]
    return times_s, [100.0 + each + noise.gauss(0.0, 0.3) for each in grown]


def test_a_leak_is_found_and_its_slope_told():
    growth = measure_growth(*samples(per_hour=20.0), limit_per_hour=4.0, least=1.0)
    assert growth is not None
    assert growth.is_growing
    assert growth.is_certain
    assert growth.low < 20.0 < growth.high


def test_noise_around_a_level_is_no_growth():
    growth = measure_growth(*samples(per_hour=0.0), limit_per_hour=4.0, least=1.0)
    assert growth is not None
    assert not growth.is_growing
    assert growth.is_certain


def test_a_peak_and_what_happens_in_the_warm_up_are_no_growth():
    times_s, values = samples(per_hour=0.0)
    values[:200] = [value - 50.0 for value in values[:200]]
    values[800:860] = [value + 200.0 for value in values[800:860]]
    growth = measure_growth(times_s, values, limit_per_hour=4.0, least=1.0)
    assert growth is not None
    assert not growth.is_growing
    assert growth.is_certain


def test_one_more_thread_every_few_minutes_is_found():
    times_s = [float(second) for second in range(3600)]
    growth = measure_growth(times_s, [7 + t // 300 for t in times_s], limit_per_hour=0.5, least=0.5)
    assert growth is not None
    assert growth.is_growing


def test_a_small_step_in_a_short_run_is_not_certain():
    times_s = [float(second) for second in range(180)]
    values = [49.7 + 0.3 * min(1.0, max(0.0, time_s - 60.0) / 90.0) for time_s in times_s]
    growth = measure_growth(times_s, values, limit_per_hour=4.0, least=1.0)
    assert growth is not None
    assert not growth.is_growing
    assert not growth.is_certain


def test_too_few_samples_say_nothing():
    times_s, values = samples(per_hour=20.0, minutes=1.0)
    assert measure_growth(times_s, values, limit_per_hour=4.0, least=1.0) is None
    assert measure_growth([], [], limit_per_hour=4.0, least=1.0) is None


def test_the_first_command_for_a_state_after_the_action_answers_the_frame():
    matcher = LatencyMatcher()
    matcher.take(5 * MS, action(frame_ns=1 * MS, sent_ns=4 * MS))
    matcher.take(6 * MS, command(state_ns=3 * MS))
    matcher.take(14 * MS, command(state_ns=13 * MS))
    matcher.take(24 * MS, command(state_ns=23 * MS))
    assert matcher.latencies_s == [pytest.approx(0.013)]


def test_a_command_of_another_episode_answers_nothing():
    matcher = LatencyMatcher()
    matcher.take(5 * MS, action(frame_ns=1 * MS, sent_ns=4 * MS))
    matcher.take(14 * MS, command(state_ns=13 * MS, epoch=2))
    assert matcher.latencies_s == []


def test_actions_that_get_no_command_cost_bounded_memory():
    matcher = LatencyMatcher()
    for number in range(1000):
        matcher.take(number, action(frame_ns=number, sent_ns=number))
    matcher.take(2 * MS, command(state_ns=1 * MS))
    assert len(matcher.latencies_s) == 100


def test_the_tap_keeps_every_message_with_its_arrival():
    tap, topic = ArrivalTap(), topic_of(RobotCommand)
    payload = encode(command(state_ns=7))
    for _ in range(3):
        encoding = encoding_of(RobotCommand)
        tap.put(Received(topic, key_of(topic, "sim-0"), encoding, payload))
    taken = list(tap.take_all())
    assert [message for _, message in taken] == [command(state_ns=7)] * 3
    assert sorted(arrived_ns for arrived_ns, _ in taken) == [ns for ns, _ in taken]
    assert topic in TOPICS
    assert list(tap.take_all()) == []


def test_a_process_is_measured_and_its_successor_counted():
    sampler = Sampler()
    sampler.sample(1.0, {"sim-0": os.getpid()})
    sampler.sample(2.0, {"sim-0": os.getppid()})
    assert sampler.restarts == ["sim-0"]
    series = sampler.series["sim-0"]
    assert series.times_s == [1.0, 2.0]
    assert series.values["MB"][0] > 1.0
    assert series.values["threads"][0] >= 1.0


def test_a_process_that_is_gone_leaves_a_gap():
    sampler = Sampler()
    sampler.sample(1.0, {"sim-0": 2**30})
    assert "sim-0" not in sampler.series
