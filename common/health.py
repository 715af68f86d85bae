"""Whether a service process is ready: a file that it touches, and `python -m common.health`.

A process touches the file that the environment names once a second, from the thread that does its
work, while it is ready and linked to a router. The file is therefore old when the process has not
started yet, hangs, or has lost the router. Looking at its age imports no service and opens no
session, so a container can be asked every few seconds at no cost.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import Self

from common.errors import NotWritable

VARIABLE = "LEGATO_HEARTBEAT"
"""Environment variable that names the file; without it none is touched."""

PERIOD_S = 1.0
OLDEST_S = 5.0
"""A heartbeat older than this is none; some messages take a second or two to handle."""


class Heartbeat:
    """A file whose age says how long ago a process was ready.

    Args:
        path: The file.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._next_ns = 0

    @classmethod
    def from_environment(cls) -> Self | None:
        """The heartbeat that the environment asks for, or none."""
        path = os.environ.get(VARIABLE)
        return cls(Path(path)) if path else None

    def is_due(self, now_ns: int) -> bool:
        """Whether the last beat is a period ago.

        Args:
            now_ns: Monotonic time.
        """
        return now_ns >= self._next_ns

    def beat(self, now_ns: int) -> None:
        """Touch the file.

        Args:
            now_ns: Monotonic time.

        Raises:
            NotWritable: The file cannot be touched.
        """
        self._next_ns = now_ns + int(PERIOD_S * 1e9)
        try:
            self._path.touch()
        except OSError as error:
            raise NotWritable(str(self._path), error.strerror or str(error)) from error

    def age_s(self) -> float | None:
        """Time since the last beat [s], or None when there never was one."""
        try:
            touched_s = self._path.stat().st_mtime
        except FileNotFoundError:
            return None
        return abs(time.time() - touched_s)


def check(heartbeat: Heartbeat | None) -> str | None:
    """What speaks against the readiness of a process, or None when it is ready.

    Args:
        heartbeat: Of the process.
    """
    if heartbeat is None:
        return f"{VARIABLE} is not set; set it to the file that the process touches"
    age_s = heartbeat.age_s()
    if age_s is None:
        return "not ready yet: no heartbeat"
    if age_s > OLDEST_S:
        return f"hangs or has lost the router: last heartbeat {age_s:.0f} s ago"
    return None


def main() -> int:
    """Say whether the process is ready; return 0 if it is and 1 if not."""
    problem = check(Heartbeat.from_environment())
    sys.stdout.write(f"{problem or 'ready'}\n")
    return 0 if problem is None else 1


if __name__ == "__main__":
    sys.exit(main())
