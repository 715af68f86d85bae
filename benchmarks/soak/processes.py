"""What the processes of a deployment take: memory, threads, file descriptors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import psutil

QUANTITIES = ("MB", "threads", "files")
LIMITS_PER_HOUR: Mapping[str, float] = {"MB": 4.0, "threads": 0.5, "files": 0.5}
"""Slopes that are no growth: 0.1 GB a day, which is what caches of a run still gain."""
LEAST: Mapping[str, float] = {"MB": 3.0, "threads": 0.5, "files": 0.5}
"""Changes that a short run cannot tell from noise."""


@dataclass
class Series:
    """Samples of one node's process."""

    times_s: list[float] = field(default_factory=list[float])
    values: dict[str, list[float]] = field(
        default_factory=lambda: {name: [] for name in QUANTITIES}
    )


class Sampler:
    """Samples processes by their ids and notes when a node has another one."""

    def __init__(self) -> None:
        self.series: dict[str, Series] = {}
        self.restarts: list[str] = []
        self._pids: dict[str, int] = {}

    def sample(self, now_s: float, pids: Mapping[str, int]) -> None:
        """Take one sample of every process.

        Args:
            now_s: Monotonic time.
            pids: Process ids by node.
        """
        for node, pid in pids.items():
            if self._pids.setdefault(node, pid) != pid:
                self._pids[node] = pid
                self.restarts.append(node)
            try:
                taken = _measure(psutil.Process(pid))
            except psutil.NoSuchProcess:
                # The next sample finds its successor, and counts it.
                continue
            series = self.series.setdefault(node, Series())
            series.times_s.append(now_s)
            for name, value in zip(QUANTITIES, taken, strict=True):
                series.values[name].append(value)


def _measure(process: psutil.Process) -> tuple[float, float, float]:
    with process.oneshot():
        megabytes = process.memory_info().rss / 1e6
        return megabytes, float(process.num_threads()), float(process.num_fds())
