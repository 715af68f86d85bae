"""Totals that begin anew with every episode, as increments."""

from __future__ import annotations


class Increase:
    """By how much a total has grown since it was last looked at, one per cell."""

    def __init__(self) -> None:
        self._last: dict[str, tuple[int, int]] = {}

    def since_last(self, cell: str, epoch: int, total: int) -> int:
        """What was added; a new epoch begins at 0, and a total out of order adds nothing."""
        last_epoch, last = self._last.get(cell, (epoch, 0))
        if epoch < last_epoch:
            return 0
        if epoch > last_epoch:
            last = 0
        self._last[cell] = (epoch, max(last, total))
        return max(0, total - last)
