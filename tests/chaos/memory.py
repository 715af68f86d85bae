"""How much memory the processes of a system hold over time."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping

import psutil

PERIOD_S = 0.5
LONG_LIFE_S = 30.0
"""A younger process is still loading what it needs."""
MIB = 1 << 20


class MemoryWatch:
    """Looks at the resident memory of every process twice a second.

    Args:
        pids: Gives the processes that run now, by node.
    """

    def __init__(self, pids: Callable[[], Mapping[str, int]]) -> None:
        self._pids = pids
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="memory")
        self._history_mib: dict[tuple[str, int], list[float]] = {}

    def __enter__(self) -> MemoryWatch:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    @property
    def peak_mib(self) -> dict[str, float]:
        """The most that a process of each node held."""
        peaks: dict[str, float] = {}
        for (node, _), seen in self._history_mib.items():
            peaks[node] = max(peaks.get(node, 0.0), max(seen))
        return peaks

    @property
    def growth_mib(self) -> dict[tuple[str, int], float]:
        """By how much the second half of each long life was above its first half at most."""
        return {
            key: max(seen[len(seen) // 2 :]) - max(seen[: len(seen) // 2])
            for key, seen in self._history_mib.items()
            if len(seen) * PERIOD_S >= LONG_LIFE_S
        }

    def _run(self) -> None:
        while not self._stop.wait(PERIOD_S):
            for node, pid in self._pids().items():
                try:
                    resident_mib = psutil.Process(pid).memory_info().rss / MIB
                except psutil.NoSuchProcess:
                    continue
                self._history_mib.setdefault((node, pid), []).append(resident_mib)
