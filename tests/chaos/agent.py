"""Disturbs a system at random; the same seed gives the same faults in the same order."""

from __future__ import annotations

import heapq
import random
import threading
import time
from collections.abc import Callable
from typing import Self

from tests.chaos.chronicle import Chronicle
from tests.chaos.faults import Fault, draw_faults
from tests.chaos.system import System


class ChaosAgent:
    """Applies faults on a thread of its own while its block runs; then ends those that last.

    A lasting fault may outlast the beginning of the next one.

    Args:
        system: What is disturbed.
        seed: Of the faults and of the pauses between them.
        mean_pause_s: Between the beginnings of two faults.
        chronicle: Where they are written down.
    """

    def __init__(
        self, system: System, *, seed: int, mean_pause_s: float, chronicle: Chronicle
    ) -> None:
        self.count = 0
        self.last_s = time.monotonic()
        """When the last fault was over."""
        self._system = system
        self._faults = draw_faults(seed, system)
        self._pauses = random.Random(seed)
        self.mean_pause_s = mean_pause_s
        self._chronicle = chronicle
        self._stop = threading.Event()
        self._lasting: list[tuple[float, int, Fault, Callable[[], None]]] = []
        self._thread = threading.Thread(target=self._run, name="chaos")

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        next_s = self.last_s + self._draw_pause_s()
        try:
            while not self._stop.is_set():
                now_s = time.monotonic()
                self._end_due(now_s)
                if now_s >= next_s:
                    self._begin(next(self._faults))
                    next_s = now_s + self._draw_pause_s()
                wake_s = min([next_s, *(end_s for end_s, *_ in self._lasting)])
                self._stop.wait(max(0.0, wake_s - time.monotonic()))
        finally:
            # Nothing may stay stopped, whatever happened.
            self._end_due(float("inf"))

    def _draw_pause_s(self) -> float:
        return self._pauses.uniform(0.5, 1.5) * self.mean_pause_s

    def _begin(self, fault: Fault) -> None:
        self.count += 1
        self._chronicle.note(str(fault))
        end = fault.begin(self._system)
        self.last_s = time.monotonic()
        if end is not None:
            due = (self.last_s + fault.duration_s, self.count, fault, end)
            heapq.heappush(self._lasting, due)

    def _end_due(self, now_s: float) -> None:
        while self._lasting and self._lasting[0][0] <= now_s:
            _, _, fault, end = heapq.heappop(self._lasting)
            end()
            self.last_s = time.monotonic()
            self._chronicle.note(f"end of {fault}")
