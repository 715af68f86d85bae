"""Waiting for a deployment: ready means that every started node is alive on the bus."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

from client.api import LegatoClient
from client.deployment import Deployment
from client.errors import NodesMissing, ProcessGaveUp
from client.processes import read_last_line
from common.api import ServiceInfo
from common.errors import LegatoError

DEADLINE_S = 90.0
"""A first start on a machine compiles the camera, which takes most of it."""
POLL_S = 0.1


def wait_until_ready(
    client: LegatoClient,
    deployment: Deployment,
    *,
    given_up: Callable[[], Mapping[str, str]],
    deadline_s: float = DEADLINE_S,
) -> list[ServiceInfo]:
    """Poll the control plane until it is ready and sees every node.

    Args:
        client: Client of the deployment's control plane.
        deployment: What was started.
        given_up: Nodes that will not come any more, with their last words.
        deadline_s: Longest wait [s].

    Returns:
        The services as the control plane shows them.

    Raises:
        ProcessGaveUp: A process failed to start again and again.
        NodesMissing: Some are not alive in time.
    """
    started_s = time.monotonic()
    while True:
        services = _list_services(client)
        missing = find_missing(deployment, services)
        if not missing and client.ready():
            return services
        lost = given_up()
        if lost:
            raise ProcessGaveUp(lost, str(deployment.logs))
        if time.monotonic() - started_s > deadline_s:
            late = missing or ["control"]
            tails = {node: read_last_line(deployment.logs / f"{node}.log") for node in late}
            raise NodesMissing(late, deadline_s, tails)
        time.sleep(POLL_S)


def find_missing(deployment: Deployment, services: list[ServiceInfo]) -> list[str]:
    """Nodes of a deployment that are not alive, given what the control plane shows.

    The router and the control plane are not looked for when there is an answer: they gave it.
    """
    if not services:
        return [spec.node for spec in deployment.processes()]
    alive = {(service.kind, service.node) for service in services if service.alive}
    return [
        spec.node
        for spec in deployment.processes()
        if spec.kind not in ("router", "control") and (spec.kind, spec.node) not in alive
    ]


def _list_services(client: LegatoClient) -> list[ServiceInfo]:
    try:
        return client.services()
    except LegatoError:
        # Not up yet; whether it ever comes is decided by the deadline.
        return []
