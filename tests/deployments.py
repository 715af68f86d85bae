"""A whole system on free ports for tests: every process real, nothing left behind."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from client.api import LegatoClient
from client.deployment import Deployment, find_free_ports, is_port_free
from client.readiness import wait_until_ready
from client.supervisor import Supervisor, open_deployment
from common.api import Evaluation, Trial
from common.errors import LegatoError

WAIT_S = 300.0
"""Bound of every wait; reached only by a test that fails, or on a machine that does nothing."""


@contextmanager
def running(
    folder: Path,
    *,
    robots: tuple[str, ...] = ("abstract", "panda"),
    cells: int = 1,
    certs: Path | None = None,
    metrics_port: int | None = None,
    lease_s: float = 10.0,
) -> Iterator[tuple[Deployment, Supervisor, LegatoClient]]:
    """Start all processes, wait until they are ready, and stop them in every case.

    The lease is long: where processes are not told to hang, they do so on a busy machine alone.
    """
    router_port, rest_port = find_free_ports(2)
    deployment = Deployment(
        robots=robots,
        cells=cells,
        rest_port=rest_port,
        router_port=router_port,
        namespace=f"test-{rest_port}",
        data=folder,
        certs=certs,
        metrics_port=metrics_port,
        lease_s=lease_s,
    )
    with (
        open_deployment(deployment) as supervisor,
        LegatoClient(deployment.url, timeout_s=30.0) as client,
    ):
        supervisor.start()
        wait_until_ready(
            client, deployment, given_up=lambda: supervisor.given_up, deadline_s=WAIT_S
        )
        yield deployment, supervisor, client


def first_of_free_ports() -> int:
    """A port that is free like the few after it: one per process of a small deployment."""
    for first in find_free_ports(20):
        if first <= 65000 and all(map(is_port_free, range(first, first + 10))):
            return first
    raise AssertionError("no row of free ports")


def kill(supervisor: Supervisor, node: str) -> int:
    """SIGKILL one process and return its id."""
    pid = supervisor.pids[node]
    os.kill(pid, signal.SIGKILL)
    return pid


def wait_for_running_trial(
    client: LegatoClient, evaluation: str, *, timeout_s: float = WAIT_S
) -> Trial:
    """Wait until some trial is in the middle of an attempt."""
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        for trial in client.trials(evaluation):
            if trial.status == "running":
                return trial
        time.sleep(0.02)
    raise AssertionError("no trial has started")


def wait_until_done(
    client: LegatoClient, evaluation: str, *, timeout_s: float = WAIT_S
) -> Evaluation:
    """Wait for the end of an evaluation by polling, so that a control plane may die meanwhile."""
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        try:
            found = client.evaluation(evaluation)
        except LegatoError:
            time.sleep(0.1)
            continue
        if found.status != "running":
            return found
        time.sleep(0.1)
    raise AssertionError(f"{evaluation} did not end within {timeout_s} s")
