"""What happened when: faults, deaths and starts, so that a failure can be understood."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Self


class Chronicle(logging.Handler):
    """Lines with the time since its beginning; takes in what the supervisor logs."""

    def __init__(self) -> None:
        super().__init__()
        self._began_s = time.monotonic()
        self._lines: list[str] = []
        self.killed: list[str] = []
        """Nodes that did not end on SIGTERM."""

    def note(self, text: str) -> None:
        """Write a line. From any thread."""
        self._lines.append(f"{time.monotonic() - self._began_s:7.2f} s  {text}")

    def emit(self, record: logging.LogRecord) -> None:
        """Take a line of the supervisor."""
        event, node = record.getMessage(), str(vars(record).get("node", ""))
        self.note(f"    {node} {event}")
        if event == "killed":
            self.killed.append(node)

    @contextmanager
    def kept(self) -> Iterator[Self]:
        """Write along, and add everything to the error if there is one."""
        log = logging.getLogger("client")
        level = log.level
        log.setLevel(logging.INFO)
        log.addHandler(self)
        try:
            yield self
        except Exception as error:
            error.add_note("\n".join(self._lines))
            raise
        finally:
            log.removeHandler(self)
            log.setLevel(level)
