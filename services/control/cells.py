"""What the guards of the cells say, for requests that wait until they say something else."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence

from common.api import CellInfo
from common.errors import NodeTimeout

ANSWER_TIMEOUT_S = 2.0
"""A guard answers within milliseconds, or as soon as its robot has come to rest."""


class CellStates:
    """The scheduler's thread writes, others read and wait."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._infos: tuple[CellInfo, ...] = ()

    @property
    def infos(self) -> tuple[CellInfo, ...]:
        """Every known cell, by name."""
        return self._infos

    def put(self, infos: tuple[CellInfo, ...]) -> None:
        """Take new states."""
        with self._changed:
            self._infos = infos
            self._changed.notify_all()

    def wait(
        self, cells: Sequence[str], wanted: Callable[[CellInfo], bool], *, what: str
    ) -> list[CellInfo]:
        """Wait until all of these cells are as wanted, and give their states.

        Args:
            cells: Names; those without a living owner are not waited for.
            wanted: Tells it of one cell.
            what: What is waited for, for the error.

        Raises:
            NodeTimeout: One of them is not.
        """
        deadline_s = time.monotonic() + ANSWER_TIMEOUT_S
        with self._changed:
            while True:
                infos = [info for info in self._infos if info.cell in cells]
                late = [info.cell for info in infos if info.alive and not wanted(info)]
                if not late:
                    return infos
                left_s = deadline_s - time.monotonic()
                if left_s <= 0.0:
                    raise NodeTimeout(f"sim {', '.join(late)}", what, ANSWER_TIMEOUT_S)
                self._changed.wait(left_s)
