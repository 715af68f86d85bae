"""The bus of one process: whoever hears a topic gets the very message, in order."""

from collections.abc import Iterator

import pytest

from common.bus import Bus, BusSettings, Handed, Inbox, LocalBus, Subscription, open_session
from common.messages import Header, Message, PolicyAction, RobotState
from common.topics import topic_of

STATE = topic_of(RobotState)


@pytest.fixture
def bus() -> Iterator[LocalBus]:
    settings = BusSettings("in_process", namespace="local")
    with open_session(settings) as session, LocalBus(session) as opened:
        yield opened


def state(step: int, cell: str = "a") -> RobotState:
    header = Header(cell=cell, step=step)
    return RobotState(header=header, positions=[0.0], velocities=[0.0], due_frame_step=-1)


def action(step: int) -> PolicyAction:
    steps = [{"translation_m": [0, 0, 0], "rotation_rad": [0, 0, 0], "grasp": False}]
    return PolicyAction.model_validate(
        {
            "header": {"cell": "a", "step": step},
            "for_step": step,
            "request_t_mono_ns": 0,
            "steps": steps,
            "inference_s": 0.0,
        }
    )


def send(bus: Bus, *messages: Message) -> None:
    for message in messages:
        bus.publish(message, owner=message.header.cell, mode="lockstep")


def taken(inbox: Inbox) -> list[Message]:
    items = inbox.drain()[1]
    assert all(isinstance(item, Handed) for item in items)
    return [item.message for item in items if isinstance(item, Handed)]


def test_the_message_itself_arrives(bus: LocalBus):
    inbox = Inbox()
    bus.subscribe(STATE, inbox)
    sent = state(3)
    send(bus, sent)
    (received,) = taken(inbox)
    assert received is sent


def test_only_the_cell_that_was_asked_for_is_heard(bus: LocalBus):
    of_a, of_all = Inbox(), Inbox()
    bus.subscribe(STATE, of_a, owner="a")
    bus.subscribe(STATE, of_all)
    a, b = state(1, "a"), state(1, "b")
    send(bus, a, b)
    assert taken(of_a) == [a]
    assert taken(of_all) == [a, b]


def test_an_inbox_keeps_as_many_as_its_topic_says(bus: LocalBus):
    inbox = Inbox()
    for topic in (STATE, topic_of(PolicyAction)):
        bus.subscribe(topic, inbox)
    messages = [state(1), action(1), state(2), action(2)]
    send(bus, *messages)
    # Of states only the newest; actions first, as in the table of topics.
    assert taken(inbox) == [messages[1], messages[3], messages[2]]
    assert inbox.superseded == 1


def test_who_unsubscribes_hears_no_more(bus: LocalBus):
    stays, leaves = Inbox(), Inbox()
    bus.subscribe(STATE, stays)
    subscription: Subscription = bus.subscribe(STATE, leaves)
    bus.unsubscribe(subscription)
    send(bus, state(1))
    assert taken(stays) == [state(1)]
    assert taken(leaves) == []


def test_the_first_message_settles_nothing_for_those_that_come_and_go(bus: LocalBus):
    stays, comes = Inbox(), Inbox()
    bus.subscribe(STATE, stays, owner="a")
    send(bus, state(1))
    subscription: Subscription = bus.subscribe(STATE, comes)
    send(bus, state(2))
    assert taken(comes) == [state(2)]
    bus.unsubscribe(subscription)
    send(bus, state(3))
    assert taken(comes) == []
    assert taken(stays) == [state(3)]
