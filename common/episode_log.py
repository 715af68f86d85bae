"""One line per episode at each of its turns, from every process that takes part in it."""

from __future__ import annotations

import logging

from common.log import about
from common.messages import (
    EpisodeAbort,
    EpisodeConfigure,
    EpisodeReady,
    EpisodeResult,
    Header,
    Message,
)

log = logging.getLogger(__name__)


class EpisodeLog:
    """Writes the turns of the episodes of one node, and knows which one a cell has now."""

    def __init__(self) -> None:
        self._current: dict[str, Header] = {}
        self._takes_part: set[str] = set()

    def begin(self, configure: EpisodeConfigure) -> None:
        """A cell gets its next episode, whoever takes part."""
        self._current[configure.header.cell] = configure.header

    def prepare(self, configure: EpisodeConfigure, *, takes_part: bool) -> None:
        """The node has been told of an episode and takes part in it, or not."""
        self._takes_part.discard(configure.header.cell)
        if takes_part:
            self._takes_part.add(configure.header.cell)
            asked = configure.model_dump(include={"task", "robot", "policy", "seed", "mode"})
            log.info("episode prepared", extra=about(configure.header) | asked)

    def abort(self, abort: EpisodeAbort) -> None:
        """An episode is stopped."""
        if abort.header.cell in self._takes_part:
            self._takes_part.remove(abort.header.cell)
            log.info("episode aborted", extra=about(abort.header) | {"reason": abort.reason})

    def send(self, message: Message) -> None:
        """What the node says of an episode: that it cannot begin, or how it ended."""
        if type(message) is EpisodeResult:
            result = message.result
            ended = {"outcome": result.outcome, "reason": result.reason, "ticks": result.ticks}
            log.info("episode ended", extra=about(message.header) | ended)
        elif type(message) is EpisodeReady and message.problem is not None:
            problem = message.problem.model_dump()
            log.warning("episode refused", extra=about(message.header) | problem)

    def about(self, cell: str) -> dict[str, object]:
        """Fields that say which episode a cell has now; none when it has none."""
        header = self._current.get(cell)
        return {} if header is None else about(header)
