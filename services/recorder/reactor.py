"""The recorder as a reactor: it listens to cells and gives whole episodes to its edge."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence

from common.log import about
from common.messages import (
    EpisodeAbort,
    EpisodeConfigure,
    EpisodeResult,
    GripperState,
    GroundTruth,
    PolicyAction,
    RetargetStatus,
    RobotState,
    StereoFrame,
)
from common.service import AnyMessage, Reactor
from services.recorder.events import EpisodeIncomplete, RecordedEpisode
from services.recorder.timeline import Timeline

log = logging.getLogger(__name__)

_RECORDED = (RobotState, StereoFrame, PolicyAction, RetargetStatus, GripperState, GroundTruth)


class RecorderReactor(Reactor):
    """Records every episode of every cell; takes part in none, so nobody waits for it.

    Returns a `RecordedEpisode` for each that ended with a success or a failure, or an
    `EpisodeIncomplete` if a message of it was lost. Aborted ones leave nothing.
    """

    kind = "recorder"
    inputs = (EpisodeConfigure, EpisodeAbort, EpisodeResult, *_RECORDED)
    packages = ("numpy",)

    def __init__(self) -> None:
        self._timelines: dict[str, Timeline] = {}

    def serves(self, cell: str) -> bool:
        """Only cells with a running episode."""
        return cell in self._timelines

    def handle(self, messages: Sequence[AnyMessage]) -> Iterable[AnyMessage]:
        """Take what is waiting; a result comes after what led to it."""
        outputs: list[AnyMessage] = []
        if len(messages) > 1:
            messages = sorted(messages, key=_comes_last)
        for message in messages:
            # First what comes a hundred times a second.
            if isinstance(message, _RECORDED):
                timeline = self._timelines.get(message.header.cell)
                if timeline is not None:
                    timeline.take(message)
            elif isinstance(message, EpisodeConfigure):
                self._begin(message)
            elif isinstance(message, EpisodeAbort):
                self._timelines.pop(message.header.cell, None)
            elif isinstance(message, EpisodeResult):
                outputs += self._end(message)
        return outputs

    def _begin(self, configure: EpisodeConfigure) -> None:
        unfinished = self._timelines.get(configure.header.cell)
        if unfinished is not None and unfinished.configure.header.epoch != configure.header.epoch:
            extra = about(unfinished.configure.header)
            log.warning("episode without an end is not recorded", extra=extra)
        self._timelines[configure.header.cell] = Timeline(configure)

    def _end(self, message: EpisodeResult) -> list[AnyMessage]:
        timeline = self._timelines.pop(message.header.cell, None)
        if timeline is None or message.result.outcome == "aborted":
            return []
        gap = timeline.find_gap()
        if gap is not None:
            return [EpisodeIncomplete(timeline.configure, gap)]
        idle = timeline.count_idle()
        rows = timeline.rows(skip=idle)
        return [RecordedEpisode(timeline.configure, message.result, rows, idle)]


def _comes_last(message: AnyMessage) -> bool:
    return isinstance(message, EpisodeResult)
