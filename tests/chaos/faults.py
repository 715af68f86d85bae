"""Disturbances of one process or of its link."""

from __future__ import annotations

import os
import random
import signal
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

from tests.chaos.system import System

SIGNALS = ("kill", "stop")
OF_LINKS = ("cut", "stall", "unplug")
LASTING = ("stop", "stall", "unplug")
SHORTEST_S, LONGEST_S = 0.2, 3.0


@dataclass(frozen=True)
class Fault:
    """One disturbance.

    Args:
        kind: `kill`, `stop` (SIGSTOP), `cut` (the connection closes), `stall` (nothing arrives),
            `unplug` (no connection).
        node: Whose process or link.
        duration_s: 0 for what does not last.
    """

    kind: str
    node: str
    duration_s: float = 0.0

    def __str__(self) -> str:
        lasting = f" for {self.duration_s:.1f} s" if self.duration_s else ""
        return f"{self.kind} {self.node}{lasting}"

    def begin(self, system: System) -> Callable[[], None] | None:
        """Do it; give back what ends it, or None if nothing has to."""
        if self.kind in SIGNALS:
            return self._signal(system.supervisor.pids.get(self.node))
        cable = system.cables[self.node]
        if self.kind == "cut":
            cable.cut()
            return None
        if self.kind == "stall":
            cable.stall()
            return cable.resume
        cable.unplug()
        return cable.plug_in

    def _signal(self, pid: int | None) -> Callable[[], None] | None:
        if pid is None:
            # Dead of an earlier fault and not started again yet.
            return None
        if self.kind == "kill":
            _send(pid, signal.SIGKILL)
            return None
        _send(pid, signal.SIGSTOP)
        return partial(_send, pid, signal.SIGCONT)


def draw_faults(seed: int, system: System) -> Iterator[Fault]:
    """Faults without end: every kind of every node once, in random order, and so on."""
    draw = random.Random(seed)
    deck = [(kind, node) for kind in SIGNALS for node in system.nodes]
    deck += [(kind, node) for kind in OF_LINKS for node in system.cables]
    while True:
        draw.shuffle(deck)
        for kind, node in deck:
            duration_s = draw.uniform(SHORTEST_S, LONGEST_S) if kind in LASTING else 0.0
            yield Fault(kind, node, duration_s)


def _send(pid: int, number: signal.Signals) -> None:
    try:
        os.kill(pid, number)
    except ProcessLookupError:
        # Killed meanwhile: as good as gone.
        return
