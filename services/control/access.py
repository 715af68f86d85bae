"""Who may call what: each route states the role that it needs, and none exists without."""

from __future__ import annotations

import math
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

from fastapi import Request, Response
from fastapi.routing import APIRoute

from common.errors import ForeignPage, KeyRefused, RoleTooLow, TooManyCalls
from common.exposure import is_loopback
from common.keys import Role
from services.control.keyring import KeyRing
from services.control.rate_limit import RateLimit

_ROLE = "x-role"
_LIMITED = "x-rate-limited"
_NOBODY = "none"
READING = frozenset({"GET", "HEAD"})
_SCHEME = "bearer "
_LONGEST_ORIGIN = 200


def needs(role: Role | None, *, limited: bool = True) -> dict[str, Any]:
    """What a route says of itself, as its `openapi_extra`.

    Args:
        role: Least role of the caller; None lets everybody in.
        limited: Whether writing calls count against the rate.
    """
    return {_ROLE: role or _NOBODY, _LIMITED: limited}


OPEN = needs(None)
VIEW = needs(Role.VIEW)
OPERATE = needs(Role.OPERATE)
ADMIN = needs(Role.ADMIN)
STOP = needs(Role.OPERATE, limited=False)
"""Of an emergency stop: however often something was called before, it is heard."""


@dataclass(frozen=True)
class Caller:
    """Who calls, for the decision and for the log."""

    name: str
    role: Role


class Guard:
    """Admits calls.

    Args:
        keys: Keys that count; without them everybody may do everything.
        limit: Bounds the writing calls of each caller, and the calls of those without a key.
    """

    def __init__(self, keys: KeyRing | None, limit: RateLimit) -> None:
        self._keys = keys
        self._limit = limit

    def admit(self, request: Request, stated: dict[str, Any]) -> None:
        """Let a call pass, and note the caller in the request's state.

        Args:
            request: The call.
            stated: What its route says, by `needs`.

        Raises:
            ForeignPage: There are no keys, and a page of another machine calls.
            KeyRefused: No key, or one that does not count.
            RoleTooLow: The key may do less.
            TooManyCalls: The caller has made too many.
        """
        if stated[_ROLE] == _NOBODY:
            return
        role = Role(stated[_ROLE])
        address = request.client.host if request.client else "unknown"
        if self._keys is None:
            _refuse_foreign_page(request)
            caller = Caller(address, Role.ADMIN)
        else:
            try:
                caller = self._identify(request, self._keys)
            except KeyRefused:
                self._count(f"address {address}")
                raise
        request.state.caller = caller
        if not caller.role.includes(role):
            raise RoleTooLow(caller.name, caller.role, role)
        if stated[_LIMITED] and request.method not in READING:
            self._count(f"key {caller.name}" if self._keys else f"address {address}")

    def _count(self, caller: str) -> None:
        wait_s = self._limit.take(caller)
        if wait_s > 0:
            raise TooManyCalls(caller, self._limit.rate_hz, math.ceil(wait_s))

    @staticmethod
    def _identify(request: Request, keys: KeyRing) -> Caller:
        header = request.headers.get("authorization", "")
        if not header:
            raise KeyRefused("the call has no API key")
        entry = None
        if header.lower().startswith(_SCHEME):
            entry = keys.find(header[len(_SCHEME) :].strip())
        if entry is None:
            raise KeyRefused("the API key is not known here, or was revoked")
        return Caller(entry.name, entry.role)


def _refuse_foreign_page(request: Request) -> None:
    """Without keys a browser on this machine would lend its reach to every page it shows.

    Programs send no `Origin`. With keys a page cannot call: browsers do not add the header.
    """
    origin = request.headers.get("origin")
    if origin is None:
        return
    try:
        host = urlsplit(origin).hostname or ""
    except ValueError:
        host = ""
    if not is_loopback(host):
        raise ForeignPage(origin[:_LONGEST_ORIGIN])


class GuardedRoute(APIRoute):
    """A route that asks the application's guard before it reads the body.

    Raises:
        TypeError: It was made without `openapi_extra=needs(...)`.
    """

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """Put the guard before the handler."""
        stated = self.openapi_extra
        if stated is None or _ROLE not in stated:
            raise TypeError(f"route {self.path} says no role: give it openapi_extra=needs(...)")
        handler = super().get_route_handler()

        async def guarded(request: Request) -> Response:
            guard: Guard = request.app.state.guard
            guard.admit(request, stated)
            return await handler(request)

        return guarded
