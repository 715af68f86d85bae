"""How long it takes until a system is whole again."""

from __future__ import annotations

import time
from dataclasses import dataclass

from client.errors import ControlUnreachable
from client.readiness import find_missing
from tests.chaos.system import System

QUIET_S = 2.0
"""Longer than it takes to notice a loss: what has been well for so long is well."""
POLL_S = 0.01


@dataclass(frozen=True)
class Recovery:
    """Times since the end of the last fault [s]; 0 if there was nothing to recover from.

    Args:
        ready_s: Until `/readyz` says ready, and goes on saying so.
        whole_s: Until also every process is there again.
    """

    ready_s: float
    whole_s: float


def measure_recovery(system: System, *, since_s: float, deadline_s: float = 60.0) -> Recovery:
    """Watch until nothing has been missing for a while.

    Args:
        system: What was disturbed.
        since_s: Monotonic time of the end of the last fault.
        deadline_s: Longest wait.

    Raises:
        TimeoutError: Something stays away.
    """
    unready_s = broken_s = since_s
    began_s = time.monotonic()
    while time.monotonic() - max(broken_s, began_s) < QUIET_S:
        ready, missing = system.client.ready(), _list_missing(system)
        now_s = time.monotonic()
        if not ready:
            unready_s = now_s
        if missing or not ready:
            broken_s = now_s
        if now_s - began_s > deadline_s:
            raise TimeoutError(f"after {deadline_s:.0f} s still missing: {missing}")
        time.sleep(POLL_S)
    return Recovery(ready_s=unready_s - since_s, whole_s=broken_s - since_s)


def _list_missing(system: System) -> list[str]:
    try:
        return find_missing(system.deployment, system.client.services())
    except ControlUnreachable:
        return ["control"]
