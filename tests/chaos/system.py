"""A whole system as `legato up` starts it, with a cable between each process and the router."""

from __future__ import annotations

import random
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from client.api import LegatoClient
from client.deployment import HOST, Deployment, ProcessSpec, is_port_free
from client.readiness import wait_until_ready
from client.supervisor import Supervisor
from tests.chaos.cable import Cable


class CabledDeployment(Deployment):
    """A deployment whose nodes reach the router through cables."""

    cable_ports: dict[str, int]
    trial_s: float

    def processes(self) -> tuple[ProcessSpec, ...]:
        """Those of `legato up`, at the near end of their cables, with short trials."""
        return tuple(self._cable(spec) for spec in super().processes())

    def _cable(self, spec: ProcessSpec) -> ProcessSpec:
        port = self.cable_ports.get(spec.node)
        arguments = tuple(
            f"--endpoint=tcp/{HOST}:{port}" if argument.startswith("--endpoint=") else argument
            for argument in spec.arguments
        )
        if spec.kind != "sim":
            return replace(spec, arguments=arguments)
        limited = (*arguments, f"--trial-s={self.trial_s}")
        return replace(spec, module="tests.chaos.sim", arguments=limited)


@dataclass(frozen=True)
class System:
    """What a test holds in its hands."""

    deployment: Deployment
    supervisor: Supervisor
    client: LegatoClient
    cables: dict[str, Cable]

    @property
    def nodes(self) -> list[str]:
        """Every process by name."""
        return [spec.node for spec in self.deployment.processes()]


@contextmanager
def running_system(
    folder: Path, *, robots: tuple[str, ...], cells: int, trial_s: float = 3.0
) -> Iterator[System]:
    """Start everything, wait until it is ready, and stop it in every case.

    Trials of the cup end after `trial_s` of simulated time.
    """
    plan = Deployment(robots=robots, cells=cells)
    cabled = [spec.node for spec in plan.processes() if spec.kind != "router"]
    router_port, rest_port, *cable_ports = find_server_ports(2 + len(cabled))
    deployment = CabledDeployment(
        robots=robots,
        cells=cells,
        rest_port=rest_port,
        router_port=router_port,
        namespace=f"chaos-{rest_port}",
        data=folder,
        cable_ports=dict(zip(cabled, cable_ports, strict=True)),
        trial_s=trial_s,
    )
    cables = {node: Cable(port, router_port) for node, port in deployment.cable_ports.items()}
    try:
        with (
            Supervisor(deployment.processes(), logs=deployment.logs) as supervisor,
            LegatoClient(deployment.url, timeout_s=30.0) as client,
        ):
            supervisor.start()
            wait_until_ready(client, deployment, given_up=lambda: supervisor.given_up)
            yield System(deployment, supervisor, client, cables)
    finally:
        for cable in cables.values():
            cable.close()


def find_server_ports(count: int) -> list[int]:
    """Free ports below those that the system gives to clients.

    A client that tries again and again to reach a port where nobody listens may be given that very
    port as its own, connect to itself, and keep a restarted server from listening there.
    """
    candidates = random.SystemRandom().sample(range(20_000, 32_000), 50 * count)
    free = (port for port in candidates if is_port_free(port))
    return [next(free) for _ in range(count)]
