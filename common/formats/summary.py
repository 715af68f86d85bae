"""What exports and imports tell of themselves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

Advance = Callable[[int, int], None]
"""Told after each episode: how many are done, of how many."""


def be_quiet(done: int, total: int) -> None:
    """Tell nobody."""


@dataclass(frozen=True)
class Summary:
    """What was made.

    Args:
        path: The new file or folder.
        episodes: How many.
        rows: Of all of them.
        notes: What else is to be known, in sentences.
    """

    path: Path
    episodes: int
    rows: int
    notes: tuple[str, ...]
