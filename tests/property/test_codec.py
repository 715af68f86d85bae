from __future__ import annotations

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.bus.codec import decode, encode, encoding_of
from common.errors import ContractError, MalformedMessage
from common.messages import ALL, Message
from common.topics import topic_of
from tests.messages_strategy import STRATEGIES, any_message


def test_every_message_has_a_strategy():
    assert set(STRATEGIES) == set(ALL)


@pytest.mark.parametrize("message_type", ALL, ids=lambda t: t.__name__)
@given(data=st.data())
def test_round_trip_is_exact(message_type: type[Message], data: st.DataObject):
    message = data.draw(STRATEGIES[message_type])
    back = decode(topic_of(message_type), encoding_of(message_type), encode(message))
    assert back == message
    assert type(back) is message_type


@given(message=any_message, cut=st.floats(0, 1, exclude_max=True))
def test_truncated_bytes_are_refused(message: Message, cut: float):
    payload = encode(message)
    with pytest.raises(MalformedMessage):
        decode(
            topic_of(type(message)),
            encoding_of(type(message)),
            payload[: int(cut * len(payload))],
        )


@given(message=any_message, noise=st.binary(max_size=200))
def test_arbitrary_bytes_never_crash(message: Message, noise: bytes):
    with pytest.raises(ContractError):
        decode(topic_of(type(message)), encoding_of(type(message)), noise)


@given(message=any_message, data=st.data())
def test_unknown_and_missing_fields_are_refused(message: Message, data: st.DataObject):
    fields = msgpack.unpackb(encode(message))
    dropped = data.draw(st.sampled_from(["header", None]))
    if dropped is None:
        fields["surprise"] = 1
    else:
        del fields[dropped]
    with pytest.raises(MalformedMessage):
        decode(topic_of(type(message)), encoding_of(type(message)), msgpack.packb(fields))


@given(message=any_message)
def test_stamping_changes_the_stamp_and_nothing_else(message: Message):
    before = message.model_copy(deep=True)
    stamped = message.stamped(source="me", seq=7, t_mono_ns=8)
    header = message.header.model_copy(update={"source": "me", "seq": 7, "t_mono_ns": 8})
    assert stamped == message.model_copy(update={"header": header})
    assert message == before
    assert encode(stamped) != encode(message) or message.header == header
