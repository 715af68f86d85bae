"""Waiting for what processes bring about."""

from __future__ import annotations

import time
from collections.abc import Callable


def wait_until(condition: Callable[[], object], *, deadline_s: float) -> None:
    """Look again and again.

    Raises:
        TimeoutError: It does not come true in time.
    """
    until_s = time.monotonic() + deadline_s
    while not condition():
        if time.monotonic() > until_s:
            raise TimeoutError(f"did not come true within {deadline_s:g} s")
        time.sleep(0.02)
