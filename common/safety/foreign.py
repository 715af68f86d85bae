"""How many messages of foreign nodes a service has dropped."""

from __future__ import annotations

from collections.abc import Iterator

from common.bus.access import kind_that_writes
from common.messages import Message
from common.metrics import Sample
from common.metrics.table import FOREIGN
from common.topics import topic_of


class ForeignCounts:
    """Messages that a service hears from the nodes of an episode alone, and those of others.

    Counted over all its cells and episodes.

    Args:
        heard: Types of the messages.
    """

    def __init__(self, *heard: type[Message]) -> None:
        self.kinds = {message: kind_that_writes(message) for message in heard}
        """Type of a message -> the kind of node that may send it."""
        self._dropped = dict.fromkeys(heard, 0)

    def add(self, message: type[Message]) -> None:
        """One was dropped."""
        self._dropped[message] += 1

    def levels(self) -> Iterator[Sample]:
        """Totals since the start."""
        for message, count in self._dropped.items():
            yield Sample(FOREIGN, count, (topic_of(message).name,))
