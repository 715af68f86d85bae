"""One writer per cell: whose messages count in an episode."""

from __future__ import annotations

import logging

from common.errors import InvalidValue
from common.log import about
from common.messages import EpisodeConfigure, Message
from common.safety.foreign import ForeignCounts

log = logging.getLogger(__name__)


class SingleWriter:
    """Tells messages of an episode's nodes from those of anybody else.

    It trusts the name that a sender gives itself; who may write to a cell's keys at all is the
    router's to decide.

    Args:
        configure: The episode; it names its nodes.
        counts: Which messages are heard, and where those of strangers are counted.

    Raises:
        InvalidValue: The episode has no node that could send one of them.
    """

    def __init__(self, configure: EpisodeConfigure, counts: ForeignCounts) -> None:
        nodes = configure.nodes
        if missing := set(counts.kinds.values()) - nodes.keys():
            named = ", ".join(sorted(nodes)) or "none"
            expected = f"also {', '.join(sorted(missing))}"
            raise InvalidValue("EpisodeConfigure.nodes", named, expected)
        self.foreign = 0
        self._episode = configure.header
        self._counts = counts
        self._writers = {message: nodes[kind] for message, kind in counts.kinds.items()}
        self._known_strangers = set[str]()

    def accepts(self, message: Message) -> bool:
        """Whether a message comes from its writer; if not, it is counted, and logged once."""
        message_type = type(message)
        source, writer = message.header.source, self._writers[message_type]
        if source == writer:
            return True
        self.foreign += 1
        self._counts.add(message_type)
        if source not in self._known_strangers:
            self._known_strangers.add(source)
            log.error(
                "message of a foreign node dropped",
                extra={
                    **about(self._episode),
                    "message_type": message_type.__name__,
                    "from_node": source,
                    "writer": writer,
                },
            )
        return False
