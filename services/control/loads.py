"""Checkpoints that policy services are asked to load, and who waits for the answer."""

from __future__ import annotations

import queue
import secrets
import threading
from collections.abc import Sequence

from common.errors import LegatoError, NodeTimeout
from common.messages import Problem
from services.control.events import LoadPolicy, PolicyLoadEnded

LOAD_TIMEOUT_S = 60.0
"""Reading and warming up a large network takes seconds; more means that the service hangs."""


class LoadRefused(LegatoError):
    """A policy service could not load a checkpoint; the error keeps the service's own words."""

    code = "E-LOAD"
    http_status = 422

    def __init__(self, node: str, problem: Problem) -> None:
        self.node = node
        self.problem = problem
        super().__init__(
            f"{node}: {problem.happened}", expected=problem.expected, action=problem.action
        )

    def describe(self) -> dict[str, str]:
        """Give the parts of the error, with the code that the service gave."""
        return super().describe() | {"code": self.problem.code}


class LoadWaiters:
    """Lets a request wait, on its own thread, for what the scheduler hears."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._answers: dict[str, queue.Queue[PolicyLoadEnded]] = {}

    def open(self, policy: str, folder: str, nodes: Sequence[str]) -> list[LoadPolicy]:
        """One order per node; each is to be waited for."""
        orders = [LoadPolicy(f"l-{secrets.token_hex(8)}", node, policy, folder) for node in nodes]
        with self._lock:
            self._answers.update({order.request: queue.Queue() for order in orders})
        return orders

    def put(self, ended: PolicyLoadEnded) -> None:
        """An answer has come; nobody may be left who waits for it."""
        with self._lock:
            answers = self._answers.get(ended.request)
        if answers is not None:
            answers.put(ended)

    def wait(self, orders: Sequence[LoadPolicy], *, timeout_s: float = LOAD_TIMEOUT_S) -> None:
        """Wait until all orders are carried out.

        Raises:
            LoadRefused: A service could not; the others may have.
            NodeTimeout: A service gave no answer.
        """
        try:
            for order in orders:
                try:
                    ended = self._answers[order.request].get(timeout=timeout_s)
                except queue.Empty:
                    raise NodeTimeout(order.node, "PolicyLoaded", timeout_s) from None
                if ended.problem is not None:
                    raise LoadRefused(order.node, ended.problem)
        finally:
            with self._lock:
                for order in orders:
                    self._answers.pop(order.request, None)
