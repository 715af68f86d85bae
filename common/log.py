"""Structured logs: one JSON object per line on standard error.

Configured by a process's `main`, never on import.
"""

from __future__ import annotations

import json
import logging
import sys
from typing import Any

from common.messages import Header

_STANDARD = frozenset(vars(logging.makeLogRecord({}))) | {"message", "asctime", "taskName"}


class JsonFormatter(logging.Formatter):
    """Time, level, service, event, and whatever `extra=` carries (evaluation, trial, cell)."""

    def __init__(self, service: str) -> None:
        super().__init__()
        self._service = service

    def format(self, record: logging.LogRecord) -> str:
        """Write a record as one line."""
        line: dict[str, Any] = {
            "time": self.formatTime(record, "%Y-%m-%dT%H:%M:%S") + f".{int(record.msecs):03d}",
            "level": record.levelname.lower(),
            "service": self._service,
            "event": record.getMessage(),
        }
        line |= {key: value for key, value in vars(record).items() if key not in _STANDARD}
        if record.exc_info:
            line["traceback"] = self.formatException(record.exc_info)
        return json.dumps(line, default=str)


def about(header: Header) -> dict[str, Any]:
    """Fields for `extra=` that say which episode a line is about.

    Explicit, not of the context: one call of a service may be about the episodes of several cells.

    Args:
        header: Of any message of the episode. Its episode is `<evaluation>.<trial>.<attempt>` where
            a control plane made it.

    Returns:
        `cell`, `epoch`, and `evaluation`, `trial` and `attempt`, or `episode` in one piece.
    """
    fields: dict[str, Any] = {"cell": header.cell, "epoch": header.epoch}
    evaluation, *numbers = header.episode.rsplit(".", 2)
    if len(numbers) == 2 and all(number.isdecimal() for number in numbers):
        trial, attempt = map(int, numbers)
        return fields | {"evaluation": evaluation, "trial": trial, "attempt": attempt}
    return fields | {"episode": header.episode}


def configure_logging(service: str, *, level: str = "INFO") -> None:
    """Send this process's log to standard error as JSON lines."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(JsonFormatter(service))
    root = logging.getLogger()
    root.handlers = [handler]
    root.setLevel(level)
