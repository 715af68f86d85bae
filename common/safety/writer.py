"""One writer per cell: who may tell its robot what to do."""

from __future__ import annotations

import logging
from collections.abc import Mapping

from common.messages import Message

log = logging.getLogger(__name__)


class SingleWriter:
    """Tells messages of a cell's nodes from those of anybody else.

    It trusts the name that a sender gives itself; who may write to a cell's keys at all is the
    router's to decide.

    Args:
        cell: The cell, for the log.
        writers: Message type -> the one node that may send it.
    """

    def __init__(self, cell: str, writers: Mapping[type[Message], str]) -> None:
        self.foreign = 0
        self._cell = cell
        self._writers = dict(writers)
        self._known_strangers = set[str]()

    def accepts(self, message: Message) -> bool:
        """Whether a message comes from its writer; if not, it is counted, and logged once."""
        source, writer = message.header.source, self._writers[type(message)]
        if source == writer:
            return True
        self.foreign += 1
        if source not in self._known_strangers:
            self._known_strangers.add(source)
            log.error(
                "message of a foreign node dropped",
                extra={
                    "cell": self._cell,
                    "message_type": type(message).__name__,
                    "from_node": source,
                    "writer": writer,
                },
            )
        return False
