"""Ctrl-C and SIGTERM end a command the same way: clean up, exit code 130."""

from __future__ import annotations

import signal
import threading
from collections.abc import Generator
from contextlib import contextmanager
from types import FrameType

INTERRUPTED = 130
"""Exit code of a command that was interrupted."""

_NUMBERS = (signal.SIGINT, signal.SIGTERM)


def install_interrupts() -> None:
    """Let the first SIGINT or SIGTERM raise KeyboardInterrupt; later ones are ignored.

    Cleaning up takes at most a few seconds and must not be interrupted itself. The handlers are
    functions, not SIG_IGN, because child processes would inherit the latter.
    """
    for number in _NUMBERS:
        signal.signal(number, _interrupt)


def stop_on_signals(stop: threading.Event) -> None:
    """Let SIGINT and SIGTERM set an event, in a process that only waits for it."""
    for number in _NUMBERS:
        signal.signal(number, lambda number, frame: stop.set())


def was_interrupted() -> bool:
    """Whether a KeyboardInterrupt was raised since `install_interrupts`.

    One that comes inside a callback of an extension may arrive as that extension's own error:
    pydantic gives a PydanticSerializationError.
    """
    return signal.getsignal(signal.SIGINT) is _ignore


@contextmanager
def postpone_interrupts(stop: threading.Event) -> Generator[None, None, None]:
    """Let SIGINT and SIGTERM set an event inside a block that must end in an orderly way."""
    before = {number: signal.getsignal(number) for number in _NUMBERS}
    stop_on_signals(stop)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _interrupt(number: int, frame: FrameType | None) -> None:
    for each in _NUMBERS:
        signal.signal(each, _ignore)
    raise KeyboardInterrupt


def _ignore(number: int, frame: FrameType | None) -> None:
    """Already stopping."""
