"""A process that runs one shard; its order is the first argument.

It stops when its input ends: whoever has started it wants it to stop, or is gone.
"""

from __future__ import annotations

import sys
import threading
from typing import TextIO

from client.failures import exit_code_of, format_error
from client.interrupts import INTERRUPTED
from client.progress import LineProgress
from client.sharding.run import ShardOrder, run_shard
from common.errors import LegatoError


def main() -> int:
    """Run the shard; exit codes and errors are those of `legato eval --shard`."""
    stop = threading.Event()
    threading.Thread(target=_stop_at_end, args=(sys.stdin, stop), daemon=True).start()
    return run_order(ShardOrder.model_validate_json(sys.argv[1]), stop=stop)


def run_order(order: ShardOrder, *, stop: threading.Event) -> int:
    """Run a shard, tell on standard error how far it is and why it fails; return an exit code."""
    try:
        summary = run_shard(order, open_display=lambda: LineProgress(sys.stderr), stop=stop)
    except LegatoError as error:
        sys.stderr.write(f"shard {order.shard}: {format_error(error)}\n")
        return exit_code_of(error)
    return 0 if summary.done == summary.trials else INTERRUPTED


def _stop_at_end(stream: TextIO, stop: threading.Event) -> None:
    stream.read()
    stop.set()


if __name__ == "__main__":
    sys.exit(main())
