"""Images that are built once, and one system that most tests use."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from client.api import LegatoClient
from client.deployment import find_free_ports
from tests.compose.projects import BUILD_S, Project, gateway, started, why_not


@dataclass(frozen=True)
class System:
    """A running system, its REST client and where other hosts reach its router."""

    project: Project
    client: LegatoClient
    router: str


@pytest.fixture(scope="session")
def images() -> None:
    """Build the images, or skip where nothing can."""
    reason = why_not()
    if reason is not None:
        pytest.skip(reason)
    Project().compose("build", "--quiet", timeout_s=BUILD_S)


@pytest.fixture(scope="session")
def system(images) -> Iterator[System]:
    """Everything that `docker compose up` starts, on free ports."""
    rest_port, router_port = find_free_ports(2)
    # Containers of another project cannot reach this machine's loopback.
    router = f"{gateway()}:{router_port}"
    project = Project(env={"LEGATO_PORT": str(rest_port), "LEGATO_ROUTER": router})
    with (
        started(project),
        LegatoClient(f"http://127.0.0.1:{rest_port}", timeout_s=30.0) as client,
    ):
        yield System(project, client, router)
