"""Where a process offers its metrics."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class MetricsSettings:
    """An address of this machine that Prometheus asks.

    Args:
        port: TCP port; 0 = any that is free.
        host: Address that is listened on.
    """

    port: int
    host: str = "127.0.0.1"
