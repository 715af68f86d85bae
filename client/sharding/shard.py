"""Which trials of a grid are whose."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Self

from common.errors import InvalidValue

MAX_SHARDS = 100_000
FILES = "shard-*.jsonl"
_TEXT = re.compile(r"(\d{1,6})/(\d{1,6})", re.ASCII)


@dataclass(frozen=True)
class Shard:
    """Shard `number` of `count`, from 0.

    It is a run of consecutive trials. The grid counts robots, policies and tasks before it comes
    to the next index, so every shard has as many trials of each robot, policy and task as any
    other one, or one more, whatever they cost. Every count-th trial would not do: of two robots
    and two shards, the one would get all trials of the first robot.
    """

    number: int
    count: int

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read `i/n`.

        Raises:
            InvalidValue: It is something else, or i is not below n.
        """
        found = _TEXT.fullmatch(text)
        number, count = (int(found[1]), int(found[2])) if found else (0, 0)
        if not number < count <= MAX_SHARDS:
            raise InvalidValue("--shard", text, f"i/n with 0 <= i < n <= {MAX_SHARDS}, e.g. 0/8")
        return cls(number, count)

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    @property
    def file_name(self) -> str:
        """Name of its file."""
        return f"shard-{self.number:05d}-of-{self.count:05d}.jsonl"

    def trials(self, total: int) -> range:
        """Its trials, by their numbers in the grid; none if there are more shards than trials."""
        return range(self.number * total // self.count, (self.number + 1) * total // self.count)
