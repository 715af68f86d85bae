"""Shards in as many processes of this machine."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Sequence

from client.interrupts import INTERRUPTED
from client.sharding.errors import ShardFailed
from client.sharding.run import ShardOrder

COMMAND = (sys.executable, "-m", "client.sharding.worker")
_LOOK_S = 0.1
"""How often an interrupt and the end of a process are looked for."""


def run_workers(orders: Sequence[ShardOrder], *, stop: threading.Event) -> bool:
    """Run shards, each in a process of its own, and wait for all of them.

    Args:
        orders: The shards.
        stop: Ends all processes when set; what has ended stays.

    Returns:
        Whether all of them are complete.

    Raises:
        ShardFailed: A process has ended with an error; the others were stopped.
    """
    running = [_start(order) for order in orders]
    try:
        while any(process.poll() is None for process in running):
            if stop.wait(_LOOK_S) or any(process.returncode for process in running):
                _stop(running)
    finally:
        _stop(running)
    for order, process in zip(orders, running, strict=True):
        if process.returncode not in (0, INTERRUPTED):
            raise ShardFailed(str(order.shard), process.returncode)
    return all(process.returncode == 0 for process in running)


def _start(order: ShardOrder) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [*COMMAND, order.model_dump_json()],
        stdin=subprocess.PIPE,
        # One thread each: their number is the parallelism.
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
        # Ctrl-C goes to the parent alone, which stops them.
        start_new_session=True,
    )


def _stop(running: Sequence[subprocess.Popen[bytes]]) -> None:
    """Let all of them end after what they are writing, and wait for it."""
    for process in running:
        if process.stdin is not None:
            process.stdin.close()
    for process in running:
        process.wait()
