"""What every message promises: its name, its bytes, and what it refuses."""

from __future__ import annotations

import math

import pytest
from pydantic import ValidationError

from common import messages as m
from common.bus.codec import decode, encode, encoding_of
from common.errors import MalformedMessage, SchemaMismatch, UnknownName
from common.topics import TOPICS, key_of, owner_of, topic_named, topic_of, topics_of


def state(**changes: object) -> m.RobotState:
    fields: dict[str, object] = {
        "header": m.Header(cell="sim-0", epoch=3, step=4),
        "positions": [0.5, -0.25],
        "velocities": [0.0, 1.0],
    }
    return m.RobotState.model_validate(fields | changes)


def test_each_message_has_exactly_one_topic():
    assert len(TOPICS) == len(m.ALL)
    assert {topic.message for topic in TOPICS} == set(m.ALL)
    assert len({topic.name for topic in TOPICS}) == len(TOPICS)


@pytest.mark.parametrize("topic", TOPICS, ids=lambda t: t.name)
def test_keys_name_their_owner(topic):
    key = key_of(topic, "sim-0")
    assert owner_of(topic, key) == "sim-0"
    assert not key.startswith("/")
    assert not key.endswith("/")


def test_topics_keep_the_order_of_the_table():
    assert [t.name for t in topics_of([m.RobotState, m.EpisodeAbort])] == [
        "episode/abort",
        "robot/state",
    ]


def test_unknown_topic_suggests_the_near_one():
    with pytest.raises(UnknownName) as caught:
        topic_named("robot/stat")
    assert caught.value.suggestion == "robot/state"


def test_golden_bytes():
    """The wire is plain msgpack with named fields; a change of these bytes needs a new version."""
    message = m.EpisodeStart(
        header=m.Header(
            cell="c", episode="e", epoch=1, source="s", seq=2, step=3, t_sim_s=0.5, t_mono_ns=4
        )
    )
    assert encode(message) == (
        b"\x81\xa6header\x88\xa4cell\xa1c\xa7episode\xa1e\xa5epoch\x01\xa6source\xa1s\xa3seq\x02"
        b"\xa4step\x03\xa7t_sim_s\xcb?\xe0\x00\x00\x00\x00\x00\x00\xa9t_mono_ns\x04"
    )
    assert encoding_of(m.EpisodeStart) == "application/msgpack;legato.EpisodeStart.v1"


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_numbers_must_be_finite(value: float):
    with pytest.raises(ValidationError):
        state(positions=[value])


@pytest.mark.parametrize("value", [["1.5"], [True], [], [0.0] * 65, None, "x"])
def test_arrays_are_checked(value: object):
    with pytest.raises(ValidationError):
        state(positions=value)


def test_messages_are_frozen():
    with pytest.raises(ValidationError):
        state().positions = [1.0]  # type: ignore[misc]


def test_another_version_is_refused():
    topic = topic_of(m.RobotState)
    with pytest.raises(SchemaMismatch) as caught:
        decode(topic, "application/msgpack;legato.RobotState.v2", encode(state()))
    assert caught.value.expected_schema == "application/msgpack;legato.RobotState.v1"
    assert "same version" in caught.value.action


def test_truncated_image_is_refused():
    frame = m.StereoFrame(
        header=m.Header(),
        camera="t265",
        width=4,
        height=2,
        left=bytes(8),
        right=bytes(8),
        due_step=0,
    )
    short = encode(frame).replace(b"\xc4\x08" + bytes(8), b"\xc4\x07" + bytes(7), 1)
    with pytest.raises(MalformedMessage, match="left image has 7 bytes, expected 8"):
        decode(topic_of(m.StereoFrame), encoding_of(m.StereoFrame), short)


@pytest.mark.parametrize("bad", ["", "a/b", "*", "a b", "x" * 65, "#"])
def test_names_may_stand_in_a_key(bad: str):
    with pytest.raises(ValidationError):
        m.EpisodeReady(header=m.Header(), node=bad, kind="sim")
