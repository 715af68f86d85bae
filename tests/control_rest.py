"""The whole control plane in one process: scheduler, fake nodes, database and application."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import httpx
from fastapi import FastAPI

from common.api import PREFIX, Evaluation
from common.service import Host
from services.control.app import create_app
from services.control.database import Database
from services.control.deployment import Deployment
from services.control.plane import ControlPlane
from services.control.queries import Queries
from services.control.scheduler import Scheduler
from services.control.sink import ResultSink
from services.control.store import Store
from services.control.subscriptions import Subscriptions
from tests.control_nodes import CATALOG, FakeNode, one_process

WAIT_S = 30.0
"""Bound of every wait; reached only by a test that fails."""


def ask(app: FastAPI, method: str, path: str, **options) -> httpx.Response:
    """Send one request to an application."""

    async def send() -> httpx.Response:
        transport = httpx.ASGITransport(app, raise_app_exceptions=False)
        async with httpx.AsyncClient(transport=transport, base_url="http://test") as client:
            return await asyncio.wait_for(client.request(method, path, **options), WAIT_S)

    return asyncio.run(send())


@dataclass
class RunningPlane:
    """A control plane at work, and a way to talk to it."""

    plane: ControlPlane
    nodes: dict[str, FakeNode]
    host: Host

    def request(self, method: str, path: str, **options) -> httpx.Response:
        return ask(create_app(self.plane), method, path, **options)

    def get(self, path: str) -> httpx.Response:
        return self.request("GET", PREFIX + path)

    def post(self, **fields) -> httpx.Response:
        body = {"tasks": ["lid"], "robots": ["panda"], "policy": "expert", "trials": 1} | fields
        return self.request("POST", f"{PREFIX}/evaluations", json=body)

    def wait_until(self, condition) -> None:
        """Wait for something that the worker thread brings about."""
        pause = threading.Event()
        for _ in range(int(WAIT_S / 0.01)):
            if condition():
                return
            pause.wait(0.01)
        raise AssertionError("waited in vain")

    def wait_for_end(self, evaluation: str) -> Evaluation:
        self.wait_until(lambda: self.plane.evaluation(evaluation).status != "running")
        return self.plane.evaluation(evaluation)


@contextmanager
def running_plane(
    nodes: Sequence[FakeNode], *, url: str = "sqlite://", rejoin_s: float = 60.0
) -> Iterator[RunningPlane]:
    """Run scheduler and nodes on a thread of their own until the block ends."""
    database = Database(url)
    store, queries = (kind(database, namespace="legato") for kind in (Store, Queries))
    deployment, subscriptions = Deployment(), Subscriptions()
    stop = threading.Event()
    sink = ResultSink(store, deployment, subscriptions.notify)
    with one_process(Scheduler(rejoin_s=rejoin_s), nodes, sink) as (runner, host):
        for submitted in store.resume():
            host.inbox.put_event(submitted)
        thread = threading.Thread(target=runner.run, args=(stop.is_set,))
        thread.start()
        send = host.inbox.put_event
        plane = ControlPlane(store, queries, deployment, CATALOG, subscriptions, send)
        running = RunningPlane(plane, {node.node: node for node in nodes}, host)
        try:
            described = {node.kind for node in nodes}
            running.wait_until(lambda: all(deployment.ready(kind) for kind in described))
            yield running
        finally:
            stop.set()
            thread.join()
            database.close()
