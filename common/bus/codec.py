"""Messages as msgpack, checked on the way in."""

from __future__ import annotations

from functools import cache

import msgpack
import ormsgpack
from pydantic import ValidationError

from common.errors import MalformedMessage, SchemaMismatch
from common.messages import Message
from common.topics import Topic

MEDIA_TYPE = "application/msgpack"


@cache
def encoding_of(message: type[Message]) -> str:
    """Zenoh encoding of a message type: media type and schema with version."""
    return f"{MEDIA_TYPE};{message.schema_name()}"


def encode(message: Message) -> bytes:
    """Plain msgpack of a message: maps with field names, arrays, bin for images."""
    return ormsgpack.packb(message, option=ormsgpack.OPT_SERIALIZE_PYDANTIC)


def decode(topic: Topic, encoding: str, payload: bytes) -> Message:
    """Message of the topic's type from its bytes.

    Raises:
        SchemaMismatch: The encoding names another schema or version.
        MalformedMessage: The bytes are not msgpack, or a field is missing, unknown, of another
            type, out of range, not finite, or of another length.
    """
    expected = encoding_of(topic.message)
    if encoding != expected:
        raise SchemaMismatch(topic.name, expected, encoding)
    try:
        # msgpack bounds every length by the size of the buffer; ormsgpack has no such switches.
        fields = msgpack.unpackb(payload, raw=False, strict_map_key=True)
    except (ValueError, msgpack.UnpackException, msgpack.OutOfData) as error:
        schema = topic.message.schema_name()
        raise MalformedMessage(topic.name, schema, f"not msgpack: {error}") from error
    try:
        return topic.message.model_validate(fields)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(str(part) for part in first["loc"]) or "message"
        schema = topic.message.schema_name()
        raise MalformedMessage(topic.name, schema, f"{where}: {first['msg']}") from error
