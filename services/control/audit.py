"""Who did what, and how it ended: one line in the log per operating call."""

from __future__ import annotations

import logging
from dataclasses import dataclass

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from services.control.access import READING, Caller

log = logging.getLogger(__name__)

_LONGEST_PATH = 200
_REFUSED = (401, 403)


@dataclass
class _Outcome:
    """How a call ended. An exception that leaves the application is answered outside of it."""

    status: int = 500
    made: str | None = None


class Audit:
    """ASGI middleware: logs writing calls of known callers, and every call that is refused."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a call on and note its outcome."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        outcome = _Outcome()

        async def noted(message: Message) -> None:
            if message["type"] == "http.response.start":
                outcome.status = message["status"]
                outcome.made = Headers(raw=message["headers"]).get("location")
            await send(message)

        state = scope.setdefault("state", {})
        try:
            await self._app(scope, receive, noted)
        finally:
            caller: Caller | None = state.get("caller")
            operating = caller is not None and scope["method"] not in READING
            if operating or outcome.status in _REFUSED:
                _write(scope, caller, outcome)


def _write(scope: Scope, caller: Caller | None, outcome: _Outcome) -> None:
    client = scope.get("client")
    log.log(
        logging.INFO if outcome.status < 400 else logging.WARNING,
        "call",
        extra={
            "caller": None if caller is None else caller.name,
            "role": None if caller is None else caller.role,
            "address": client[0] if client else None,
            "method": scope["method"],
            "path": scope["path"][:_LONGEST_PATH],
            "status": outcome.status,
            "made": outcome.made,
        },
    )
