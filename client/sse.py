"""Server-sent events: the little of the format that the control plane uses."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass


@dataclass(frozen=True)
class ServerEvent:
    """One event of a stream."""

    name: str
    data: str


def parse_events(lines: Iterable[str]) -> Iterator[ServerEvent]:
    """Read events from the lines of a `text/event-stream`.

    An event ends at an empty line; several `data` lines are joined by line feeds; comments and
    unknown fields are skipped; an event cut off by the end of the stream is dropped.

    Source: HTML Living Standard, section 9.2.6.
    """
    name, data = "message", list[str]()
    for line in lines:
        if not line:
            if data:
                yield ServerEvent(name, "\n".join(data))
            name, data = "message", []
            continue
        field, _, value = line.partition(":")
        value = value.removeprefix(" ")
        if field == "event":
            name = value
        elif field == "data":
            data.append(value)
