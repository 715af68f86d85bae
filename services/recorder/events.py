"""What the recorder tells its edge."""

from __future__ import annotations

from dataclasses import dataclass

from common.datasets import EpisodeRows
from common.messages import EpisodeConfigure, LocalMessage, TrialResult


@dataclass(frozen=True)
class RecordedEpisode(LocalMessage):
    """An episode has ended and everything of it is there.

    Args:
        configure: What was asked for.
        result: How it ended: a success or a failure.
        rows: One row per frame.
        idle_rows: Frames at the start that were left out because nothing moved.
    """

    configure: EpisodeConfigure
    result: TrialResult
    rows: EpisodeRows
    idle_rows: int


@dataclass(frozen=True)
class EpisodeIncomplete(LocalMessage):
    """An episode has ended, but a message of it never came: it is no demonstration."""

    configure: EpisodeConfigure
    problem: str
