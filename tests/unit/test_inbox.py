from __future__ import annotations

import signal
import threading
import time

from common.bus.inbox import Inbox, Received
from common.messages import PolicyAction, RobotState
from common.topics import Topic, key_of, topic_named, topic_of


def received(topic: Topic, owner: str, payload: bytes) -> Received:
    return Received(topic, key_of(topic, owner), "", payload)


def make_inbox(*topics: Topic) -> Inbox:
    inbox = Inbox()
    for topic in topics:
        inbox.open_topic(topic)
    return inbox


def test_newest_state_wins_per_cell_and_the_loss_is_counted():
    state = topic_of(RobotState)
    inbox = make_inbox(state)
    for owner, payload in [("a", b"1"), ("b", b"1"), ("a", b"2"), ("a", b"3")]:
        inbox.put(received(state, owner, payload))
    _, waiting = inbox.drain()
    assert {(item.key, item.payload) for item in waiting} == {
        ("cell/a/robot/state", b"3"),
        ("cell/b/robot/state", b"1"),
    }
    assert inbox.superseded == 2
    assert inbox.superseded_by_topic == {"robot/state": 2}


def test_what_waits_is_counted_by_topic():
    state, action = topic_of(RobotState), topic_of(PolicyAction)
    inbox = make_inbox(state, action)
    for topic, owner in [(state, "a"), (state, "b"), (state, "b"), (action, "a"), (action, "a")]:
        inbox.put(received(topic, owner, b""))
    inbox.put_event("question")
    assert inbox.depths() == {"robot/state": 2, "policy/action": 2}
    assert inbox.waiting_events == 1
    inbox.drain()
    assert inbox.depths() == {"robot/state": 0, "policy/action": 0}
    assert inbox.waiting_events == 0


def test_a_stalled_reader_costs_bounded_memory():
    action = topic_of(PolicyAction)
    inbox = make_inbox(action)
    for number in range(1000):
        inbox.put(received(action, "a", str(number).encode()))
    _, waiting = inbox.drain()
    assert [item.payload for item in waiting] == [b"996", b"997", b"998", b"999"]
    assert inbox.superseded == 1000 - action.depth


def test_control_is_read_before_data_whatever_came_first():
    state, start = topic_of(RobotState), topic_named("episode/start")
    inbox = make_inbox(state, start)
    inbox.put(received(state, "a", b""))
    inbox.put(received(start, "a", b""))
    _, waiting = inbox.drain()
    assert [item.topic.name for item in waiting] == ["episode/start", "robot/state"]


def test_events_are_never_lost():
    inbox = make_inbox()
    for number in range(1000):
        inbox.put_event(number)
    events, _ = inbox.drain()
    assert events == list(range(1000))


def test_wait_tells_whether_something_is_there():
    inbox = make_inbox()
    assert not inbox.wait(0.0)
    inbox.put_event("x")
    assert inbox.wait(0.0)
    assert inbox.wait(0.0)
    assert inbox.drain() == (["x"], [])
    assert not inbox.wait(0.0)
    assert inbox.drain() == ([], [])


def test_nothing_is_lost_between_many_writers_and_one_reader():
    """A swap without a lock loses what is appended to the slot that was just read."""
    configure = topic_named("episode/picture")
    inbox = make_inbox(configure)
    per_thread, threads = 2000, 4
    done = threading.Event()
    seen: list[object] = []

    def write(number: int) -> None:
        for i in range(per_thread):
            inbox.put_event((number, i))

    def read() -> None:
        while not done.is_set() or inbox.wait(0.0):
            inbox.wait(0.01)
            events, _ = inbox.drain()
            seen.extend(events)

    writers = [threading.Thread(target=write, args=(n,)) for n in range(threads)]
    reader = threading.Thread(target=read)
    reader.start()
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    done.set()
    reader.join()
    assert len(seen) == len(set(seen)) == per_thread * threads


def test_a_wait_ends_also_when_a_signal_handler_outlasts_it():
    inbox = make_inbox()
    ended = threading.Event()

    def rescue() -> None:
        if not ended.wait(10.0):
            inbox.put_event("rescue")

    rescuer = threading.Thread(target=rescue)
    before = signal.signal(signal.SIGALRM, lambda *_: time.sleep(0.2))
    rescuer.start()
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.02)
        woken = inbox.wait(0.1)
    finally:
        ended.set()
        signal.signal(signal.SIGALRM, before)
        rescuer.join()
    assert not woken
