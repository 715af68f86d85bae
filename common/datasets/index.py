"""The list of complete episodes: `episodes.jsonl`, one line each, only ever appended to."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from annotated_types import Ge, Len
from pydantic import BaseModel, ConfigDict, JsonValue, TypeAdapter, ValidationError

from common.datasets.errors import BadDataset
from common.messages.base import Natural

INDEX_FILE = "episodes.jsonl"

_CONFIG = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class EpisodeMetadata(BaseModel):
    """What is known of an episode beside its rows."""

    model_config = _CONFIG

    trial: Natural
    """i of "trial i", as in an evaluation: with the recording's seed it gives `seed`."""
    seed: Natural
    outcome: Literal["success", "failure"]
    details: dict[str, JsonValue]


class EpisodeInfo(EpisodeMetadata):
    """One line of the index: the episode exists once the line is complete."""

    start: Natural
    """Its first row."""
    length: Annotated[int, Ge(1)]
    sha256: Annotated[str, Len(64, 64)]
    """Of the bytes of its rows, column after column in the order of `dataset.json`."""

    @property
    def end(self) -> int:
        """One past its last row."""
        return self.start + self.length


@dataclass(frozen=True)
class EpisodeIndex:
    """What the index says.

    Args:
        episodes: All complete ones.
        size_bytes: Where the last complete line ends.
        torn_bytes: What follows: a line that was being written when its writer was stopped.
    """

    episodes: list[EpisodeInfo]
    size_bytes: int
    torn_bytes: int

    @property
    def rows(self) -> int:
        """Rows of all complete episodes."""
        return self.episodes[-1].end if self.episodes else 0


_LINES = TypeAdapter(list[EpisodeInfo])


def read_index(path: Path) -> EpisodeIndex:
    """Read the index; a torn last line is set aside.

    Raises:
        BadDataset: A line before the last is not valid, or the episodes do not follow each other.
    """
    payload = path.read_bytes()
    lines = payload.split(b"\n")
    torn = len(lines.pop())
    if lines and not _is_valid(lines[-1]):
        # The file system may have made the room, but not the bytes, before a power failure.
        torn += len(lines.pop()) + 1
    try:
        episodes = _LINES.validate_json(b"[" + b",".join(lines) + b"]")
    except ValidationError as error:
        wrong = next((n for n, line in enumerate(lines, 1) if not _is_valid(line)), 0)
        raise BadDataset(str(path), f"line {wrong} is not an episode") from error
    expected = 0
    for number, episode in enumerate(episodes, 1):
        if episode.start != expected:
            problem = f"line {number} starts at row {episode.start}, not {expected}"
            raise BadDataset(str(path), problem)
        expected = episode.end
    return EpisodeIndex(episodes, len(payload) - torn, torn)


def encode_line(episode: EpisodeInfo) -> bytes:
    """The line of an episode."""
    return episode.model_dump_json().encode() + b"\n"


def _is_valid(line: bytes) -> bool:
    try:
        EpisodeInfo.model_validate_json(line)
    except ValidationError:
        return False
    return True
