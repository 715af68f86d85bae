"""Lost nodes are collected for a moment before the cause is named."""

from __future__ import annotations

from collections.abc import Iterable

from common.aborts import Cause, write_reason
from services.control.nodes import ROUTER_KIND

_COLLECT_NS = 150_000_000
"""Losses of one cause arrive together: when the router stops, every token is gone within 0.1 s."""


class LossWindow:
    """Opens with the first loss and closes 0.15 s later."""

    def __init__(self) -> None:
        self._since_ns: int | None = None
        self._routers: list[str] = []

    def note(self, kind: str, node: str, now_ns: int) -> None:
        """A node was lost."""
        if self._since_ns is None:
            self._since_ns = now_ns
        if kind == ROUTER_KIND:
            self._routers.append(node)

    def is_due(self, now_ns: int) -> bool:
        """Whether the causes can be named now."""
        return self._since_ns is not None and now_ns - self._since_ns >= _COLLECT_NS

    def name_cause(self, lost: Iterable[tuple[str, str]]) -> str:
        """Why an attempt lost nodes: the router, if it went too, else the nodes themselves.

        Args:
            lost: (kind, node) of those that the attempt lost.
        """
        routers = [(ROUTER_KIND, node) for node in self._routers]
        names = ", ".join(f"{kind} {node}" for kind, node in dict.fromkeys(routers or lost))
        cause = Cause.ROUTER_LEFT if routers else Cause.NODE_LEFT
        return write_reason(cause, f"{names} left (process died or link lost)")

    def close(self) -> None:
        """Forget what was collected."""
        self._since_ns = None
        self._routers.clear()
