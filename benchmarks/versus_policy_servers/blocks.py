"""Blocks of round trips, as the one that measures asks for them on standard input.

Imports nothing but the standard library: it runs in both environments.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator

IMAGE_PX = 128 * 128
"""Bytes of one grayscale image."""
ACTION_NUMBERS = 7
"""Translation, rotation vector and grasp."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What every process is told besides its role."""
    parser.add_argument("port", type=int)
    parser.add_argument("steps", type=int, help="of one answer")


def read_orders() -> Iterator[tuple[int, float]]:
    """Count and period [s] of each block that is asked for; a period of 0 is back to back."""
    for line in sys.stdin:
        count, period_s = json.loads(line)
        yield count, period_s


def tell(message: object) -> None:
    """Answer the one that measures."""
    sys.stdout.write(json.dumps(message) + "\n")
    sys.stdout.flush()


def answer_orders(ask: Callable[[], int]) -> None:
    """Measure blocks until standard input ends.

    Args:
        ask: Makes one round trip and returns how long it took [ns].
    """
    tell("ready")
    for count, period_s in read_orders():
        times_ns: list[int] = []
        next_s = time.monotonic()
        for _ in range(count):
            if period_s:
                next_s += period_s
                time.sleep(max(0.0, next_s - time.monotonic()))
            times_ns.append(ask())
        tell(times_ns)
