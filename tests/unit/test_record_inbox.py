from __future__ import annotations

from client.recording.inbox import FrameInbox
from common.bus import Received
from common.messages import Message, RobotState, StereoFrame
from common.topics import key_of, topic_of


def put(inbox: FrameInbox, message: type[Message], payload: bytes) -> None:
    topic = topic_of(message)
    inbox.put(Received(topic, key_of(topic, "sim-0"), "", payload))


def test_states_wait_for_a_frame_and_the_newest_is_found():
    inbox = FrameInbox()
    for message in (RobotState, StereoFrame):
        inbox.open_topic(topic_of(message))
    put(inbox, RobotState, b"8")
    put(inbox, RobotState, b"9")
    assert inbox.drain() == ([], [])
    put(inbox, StereoFrame, b"frame")
    put(inbox, RobotState, b"10")
    events, received = inbox.drain()
    assert (events, [each.payload for each in received]) == ([], [b"10", b"frame"])
    put(inbox, RobotState, b"11")
    assert inbox.drain() == ([], [])
    inbox.put_event("stop")
    events, received = inbox.drain()
    assert (events, [each.payload for each in received]) == (["stop"], [b"11"])
    assert inbox.superseded == 2
