"""`legato topic list`, `echo` and `hz`."""

from __future__ import annotations

import dataclasses
import json
import sys
import time
from typing import Any

from pydantic import TypeAdapter, ValidationError

from client.commands import Bus, TopicEcho, TopicHz, TopicList
from client.tables import format_table
from client.tap import QueueTap, Rate, RateTap, open_tap
from common.bus import BusSettings, Credentials, decode
from common.errors import ContractError, InvalidValue
from common.messages.base import Name
from common.topics import TOPICS, topic_named


def list_topics(command: TopicList) -> int:
    """Show the table of topics with the rates that are seen now."""
    duration_s = _positive(command.duration_s)
    tap = RateTap()
    with open_tap(_settings(command), tap, TOPICS):
        time.sleep(duration_s)
    rates = {topic.name: tap.rates(topic, duration_s=duration_s) for topic in TOPICS}
    if command.json:
        shown = {name: [dataclasses.asdict(rate) for rate in each] for name, each in rates.items()}
        sys.stdout.write(json.dumps(shown) + "\n")
        return 0
    rows = [
        (
            *(topic.name, topic.message.schema_name(), topic.scope),
            f"{topic.rate_hz:g}" if topic.rate_hz else "sporadic",
            ", ".join(_describe(rate) for rate in rates[topic.name]) or "-",
        )
        for topic in TOPICS
    ]
    headers = ("topic", "message", "scope", "usual Hz", f"seen in {duration_s:g} s, Hz")
    sys.stdout.write(format_table(headers, rows) + "\n")
    return 0


def echo(command: TopicEcho) -> int:
    """Print messages as JSON lines."""
    topic, tap, printed = topic_named(command.topic), QueueTap(), 0
    with open_tap(_settings(command), tap, [topic], owner=_owner(command.cell)):
        while command.count <= 0 or printed < command.count:
            received = tap.take(timeout_s=0.2)
            if received is None:
                continue
            try:
                message = decode(topic, received.encoding, received.payload)
            except ContractError as error:
                sys.stderr.write(f"{error.code}  {error}\n")
                continue
            fields = {"key": received.key, **_without_bytes(message.model_dump())}
            sys.stdout.write(json.dumps(fields) + "\n")
            sys.stdout.flush()
            printed += 1
    if tap.lost:
        sys.stderr.write(f"{tap.lost} messages came faster than they could be printed\n")
    return 0


def measure(command: TopicHz) -> int:
    """Measure rates and gaps per key."""
    duration_s = _positive(command.duration_s)
    topic, tap = topic_named(command.topic), RateTap()
    with open_tap(_settings(command), tap, [topic], owner=_owner(command.cell)):
        time.sleep(duration_s)
    rates = tap.rates(topic, duration_s=duration_s)
    if command.json:
        sys.stdout.write(json.dumps([dataclasses.asdict(rate) for rate in rates]) + "\n")
    elif not rates:
        sys.stdout.write(f"nothing on {topic.name} in {duration_s:g} s\n")
    else:
        headers = ("key", "messages", "Hz", "min gap ms", "max gap ms")
        sys.stdout.write(format_table(headers, [_row(rate) for rate in rates]) + "\n")
    return 0


def _settings(command: Bus) -> BusSettings:
    credentials = None if command.certs is None else Credentials.from_folder(command.certs)
    return BusSettings(
        endpoint=command.endpoint, namespace=command.namespace, credentials=credentials
    )


def _owner(cell: str) -> str:
    try:
        return cell if cell == "*" else TypeAdapter(Name).validate_python(cell)
    except ValidationError as error:
        raise InvalidValue("--cell", cell, "the name of a cell or node, or *") from error


def _positive(duration_s: float) -> float:
    if not 0 < duration_s <= 3600:
        raise InvalidValue("--duration-s", duration_s, "more than 0 and at most 3600 seconds")
    return duration_s


def _describe(rate: Rate) -> str:
    return f"{rate.key.split('/')[1]} {rate.rate_hz:.0f}"


def _row(rate: Rate) -> tuple[str, ...]:
    gaps = ("-" if gap is None else f"{1e3 * gap:.2f}" for gap in (rate.shortest_s, rate.longest_s))
    return (rate.key, str(rate.count), f"{rate.rate_hz:.1f}", *gaps)


def _without_bytes(value: Any) -> Any:
    """The same structure with every `bytes` as its size."""
    if isinstance(value, bytes):
        return f"<{len(value)} bytes>"
    if isinstance(value, dict):
        return {key: _without_bytes(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_without_bytes(each) for each in value]
    return value
