"""What runs on one machine: a router, a control plane, cells, and a retargeter per robot."""

from __future__ import annotations

import json
import socket
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from annotated_types import Ge, Le, Len
from pydantic import BaseModel, ConfigDict

from common.errors import PortInUse
from common.lease import LeaseS
from common.messages.base import Name

HOST = "127.0.0.1"

Port = Annotated[int, Ge(1), Le(65535)]

FirstPort = Annotated[int, Ge(1), Le(65000)]
"""The first of one port per process."""


@dataclass(frozen=True)
class ProcessSpec:
    """One process: its name on the bus and how it is started.

    Args:
        kind: Kind of service.
        node: Name on the bus, and of its log file.
        module: Module that is run.
        arguments: Its command line, without `--parent-pid`.
    """

    kind: str
    node: str
    module: str
    arguments: tuple[str, ...]


class Deployment(BaseModel):
    """The services of one machine, their ports and where their results go."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    robots: Annotated[tuple[Name, ...], Len(1, 64)] = ("abstract", "panda")
    cells: Annotated[int, Ge(1), Le(64)] = 1
    rest_port: Port = 8000
    router_port: Port = 7447
    namespace: Name = "legato"
    data: Path = Path("runs")
    checkpoints: Path | None = None
    certs: Path | None = None
    log_level: str = "INFO"
    lease_s: LeaseS | None = None
    """How long a silent process is believed to be alive; None: as long as the services choose."""
    metrics_port: FirstPort | None = None
    """Port of the first process's metrics; the others follow, in the order of `processes`."""

    @property
    def url(self) -> str:
        """Where the control plane answers."""
        return f"http://{HOST}:{self.rest_port}"

    @property
    def endpoint(self) -> str:
        """Where the router listens."""
        scheme = "tcp" if self.certs is None else "tls"
        return f"{scheme}/{HOST}:{self.router_port}"

    @property
    def logs(self) -> Path:
        """Folder of the log files, one per node."""
        return self.data / "logs"

    @property
    def targets(self) -> Path:
        """File that tells Prometheus where each process offers its metrics."""
        return self.data / "prometheus-targets.json"

    def processes(self) -> tuple[ProcessSpec, ...]:
        """Every process, the router first: the others wait for it."""
        if self.metrics_port is None:
            return self._processes()
        return tuple(
            replace(spec, arguments=(*spec.arguments, f"--metrics-port={port}"))
            for port, spec in zip(self.metrics_ports(), self._processes(), strict=True)
        )

    def metrics_ports(self) -> range:
        """Ports of the metrics, one per process; none where none are offered."""
        if self.metrics_port is None:
            return range(0)
        return range(self.metrics_port, self.metrics_port + len(self._processes()))

    def write_targets(self) -> None:
        """Write the file for Prometheus, in its own format (`file_sd_configs`)."""
        targets = [
            {"targets": [f"{HOST}:{port}"], "labels": {"process": spec.node}}
            for port, spec in zip(self.metrics_ports(), self._processes(), strict=True)
        ]
        self.targets.write_text(json.dumps(targets, indent=2) + "\n")

    def _processes(self) -> tuple[ProcessSpec, ...]:
        return (
            ProcessSpec(
                "router",
                "router",
                "services.router",
                (f"--listen={HOST}:{self.router_port}", *self._common("router", endpoint=False)),
            ),
            self._service("control", "control", self._control_arguments()),
            *(self._service("sim", f"sim-{number}") for number in range(self.cells)),
            *(
                self._service("retarget", f"retarget-{robot}", (f"--robot={robot}",))
                for robot in self.robots
            ),
            self._service("gripper", "gripper"),
            self._service("policy", "policy", self._policy_arguments()),
        )

    def check_ports(self) -> None:
        """Refuse ports that something else listens on.

        Raises:
            PortInUse: Names the first one.
        """
        asked = [("router", self.router_port), ("REST", self.rest_port)]
        asked += [("metrics", port) for port in self.metrics_ports()]
        for purpose, port in asked:
            if not is_port_free(port):
                raise PortInUse(purpose, HOST, port)

    def _service(self, kind: str, node: str, own: tuple[str, ...] = ()) -> ProcessSpec:
        name = () if kind == "control" else (f"--node={node}",)
        return ProcessSpec(kind, node, f"services.{kind}", (*name, *own, *self._common(kind)))

    def _control_arguments(self) -> tuple[str, ...]:
        return (f"--host={HOST}", f"--port={self.rest_port}", f"--data={self.data}")

    def _policy_arguments(self) -> tuple[str, ...]:
        return () if self.checkpoints is None else (f"--checkpoints={self.checkpoints}",)

    def _common(self, kind: str, *, endpoint: bool = True) -> tuple[str, ...]:
        where = (f"--endpoint={self.endpoint}",) if endpoint else ()
        if self.certs is not None:
            # Its policy service runs the scripted expert too.
            role = "expert" if kind == "policy" else kind
            where += (f"--certs={self.certs / role}",)
        if self.lease_s is not None:
            where += (f"--lease-s={self.lease_s}",)
        return (*where, f"--namespace={self.namespace}", f"--log-level={self.log_level}")


def is_port_free(port: int) -> bool:
    """Whether a server could listen on a port of this machine now."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        # As servers do: a port whose last connections are still winding down is free.
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError:
            return False
    return True


def find_free_ports(count: int) -> list[int]:
    """Ports that nothing listens on, all different; chosen by the system."""
    probes = [socket.socket(socket.AF_INET, socket.SOCK_STREAM) for _ in range(count)]
    try:
        for probe in probes:
            probe.bind((HOST, 0))
        return [int(probe.getsockname()[1]) for probe in probes]
    finally:
        for probe in probes:
            probe.close()
