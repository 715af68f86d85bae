"""The file of a shard for reading: a header, then one line per trial that has ended."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from client.sharding.errors import BadShard
from client.sharding.header import ShardHeader
from common.api import Trial
from services.control.events import TrialSpec


class TrialLine(BaseModel):
    """A trial that has ended, and the pictures of it that were kept, as PNG."""

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        allow_inf_nan=False,
        ser_json_bytes="base64",
        val_json_bytes="base64",
    )

    trial: Trial
    pictures: dict[str, bytes]


@dataclass(frozen=True)
class ShardRecord:
    """What a shard's file holds. Pictures stay in it until they are asked for.

    Args:
        path: The file.
        header: Its first line.
        trials: The trials of its complete lines.
        starts: Where the line of each of them begins, by the trial's number.
        size_bytes: Where the last complete line ends; what follows was being written.
    """

    path: Path
    header: ShardHeader
    trials: list[Trial]
    starts: dict[int, int]
    size_bytes: int

    def picture(self, trial: int, name: str) -> bytes:
        """A picture of a trial; both are names that the record has."""
        with self.path.open("rb") as file:
            file.seek(self.starts[trial])
            return TrialLine.model_validate_json(file.readline()).pictures[name]

    def check_trials(self, grid: Sequence[TrialSpec]) -> None:
        """See that its trials are those of its shard, each once.

        Args:
            grid: All trials of the evaluation.

        Raises:
            BadShard: One of them is not.
        """
        own, seen = self.header.shard.trials(len(grid)), set[int]()
        for trial in self.trials:
            if trial.id not in own or trial.id in seen or not _is_of(trial, grid[trial.id]):
                raise BadShard(str(self.path), f"trial {trial.id} does not belong there")
            seen.add(trial.id)


def read_header(path: Path) -> ShardHeader | None:
    """Read the first line; None if it was being written when its writer was stopped.

    Raises:
        BadShard: It is not that of a shard that this version reads.
    """
    with path.open("rb") as file:
        line = file.readline()
    return _parse_header(path, line) if line.endswith(b"\n") else None


def read_shard(path: Path) -> ShardRecord | None:
    """Read a shard; None if there is not even a header.

    A torn last line is set aside: whoever was stopped while writing loses that trial only.

    Raises:
        BadShard: A line before the last is not valid.
    """
    first, *lines = path.read_bytes().split(b"\n")
    if not lines:
        return None
    header, end = _parse_header(path, first), len(first) + 1
    del lines[-1]
    trials: list[Trial] = []
    starts: dict[int, int] = {}
    for number, line in enumerate(lines, 1):
        trial = _parse_line(line)
        if trial is None and number == len(lines):
            # The file system may have made the room, but not the bytes, before a power failure.
            break
        if trial is None:
            raise BadShard(str(path), f"line {number + 1} is not a trial that has ended")
        trials.append(trial)
        starts[trial.id] = end
        end += len(line) + 1
    return ShardRecord(path, header, trials, starts, end)


def _parse_header(path: Path, line: bytes) -> ShardHeader:
    try:
        return ShardHeader.model_validate_json(line)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"]) or "the first line"
        raise BadShard(str(path), f"{where}: {first['msg']}") from error


def _parse_line(line: bytes) -> Trial | None:
    try:
        trial = TrialLine.model_validate_json(line).trial
    except ValidationError:
        return None
    return trial if trial.ended else None


def _is_of(trial: Trial, spec: TrialSpec) -> bool:
    fields = ("index", "task", "robot", "policy", "seed")
    return all(getattr(trial, field) == getattr(spec, field) for field in fields)
