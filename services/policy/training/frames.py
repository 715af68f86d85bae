"""Stereo images of many episodes, wherever each of them lies: in memory or in a mapped file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from services.policy.learning.images import Images


class Frames:
    """Images by row, one episode after the other, without putting them in one place.

    Args:
        episodes: Each (length, 2, px, px) uint8 in C order; at least one.
    """

    def __init__(self, episodes: Sequence[Images]) -> None:
        self._episodes = tuple(episodes)
        lengths = [len(episode) for episode in episodes]
        self._ends = np.cumsum(lengths)
        self._starts = self._ends - lengths

    def __len__(self) -> int:
        return int(self._ends[-1])

    @property
    def px(self) -> int:
        """Side of an image."""
        return self._episodes[0].shape[-1]

    def windows(self, rows: npt.NDArray[np.int64], length: int) -> Iterator[Images]:
        """Views (length, 2, px, px) of windows by their first rows; each lies within an episode."""
        numbers = np.searchsorted(self._ends, rows, side="right")
        starts = rows - self._starts[numbers]
        for number, start in zip(numbers.tolist(), starts.tolist(), strict=True):
            yield self._episodes[number][start : start + length]
