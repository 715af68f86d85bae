"""`legato demo`: from nothing to a report, and nothing left running."""

from __future__ import annotations

import sys
import time
from datetime import datetime
from pathlib import Path

from pydantic import ValidationError

from client.api import LegatoClient
from client.commands import Demo, Eval
from client.deployment import Deployment, find_free_ports
from client.progress import open_progress
from client.readiness import wait_until_ready
from client.record import EvaluationRecord, load_record
from client.report import write_report
from client.request import build_request
from client.supervisor import Supervisor, open_deployment
from client.tables import format_results
from client.verbs.evaluate import command_line
from common.api import EvaluationRequest
from common.errors import InvalidValue

LEASE_S = 10.0
"""Nothing is to be shown of processes that hang, and the machine may be busy with other things."""


def run(command: Demo) -> int:
    """Start everything, evaluate, show, report, stop."""
    started_s = time.monotonic()
    request = build_request(
        Eval(policy=(command.policy,), trials=command.trials, seed=command.seed), pictures=True
    )
    deployment = _plan(command, tuple(request.robots))
    with open_deployment(deployment) as supervisor:
        record = _evaluate(deployment, supervisor, request)
    sys.stdout.write(format_results(record.evaluation) + "\n")
    sys.stdout.write(f"report: {deployment.data / 'report.html'}\n")
    sys.stderr.write(f"done in {time.monotonic() - started_s:.0f} s, everything stopped\n")
    return 0


def _plan(command: Demo, robots: tuple[str, ...]) -> Deployment:
    """A deployment that can never collide: free ports, a folder and a namespace of its own."""
    router_port, rest_port = find_free_ports(2)
    name = f"demo-{datetime.now():%Y%m%d-%H%M%S}"
    try:
        return Deployment(
            robots=robots,
            cells=command.cells,
            rest_port=rest_port,
            router_port=router_port,
            namespace=name,
            data=_choose_folder(command.data, name),
            lease_s=LEASE_S,
        )
    except ValidationError as error:
        message = error.errors(include_url=False)[0]["msg"]
        raise InvalidValue("--cells", command.cells, message) from error


def _choose_folder(data: Path, name: str) -> Path:
    """`runs/demo-<time>`, with a number when two start in one second."""
    folder, number = data / name, 1
    while folder.exists():
        number += 1
        folder = data / f"{name}-{number}"
    return folder


def _evaluate(
    deployment: Deployment, supervisor: Supervisor, request: EvaluationRequest
) -> EvaluationRecord:
    sys.stderr.write(f"starting {len(deployment.processes())} processes in {deployment.data}\n")
    supervisor.start()
    with LegatoClient(deployment.url) as client:
        wait_until_ready(client, deployment, given_up=lambda: supervisor.given_up)
        identifier = client.submit(request).id
        with open_progress() as progress:
            for event in client.events(identifier):
                progress.update(event)
        record = load_record(client, identifier)
        # Now, while the control plane still answers for the pictures.
        write_report(record, deployment.data / "report.html", command=command_line())
    return record
