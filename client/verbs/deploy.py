"""`legato up`, `down` and `status`."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path

from pydantic import ValidationError

from client.api import LegatoClient
from client.commands import Down, Status, Up
from client.containers import compose_down, compose_up
from client.deployment import Deployment
from client.interrupts import stop_on_signals
from client.processes import read_last_line, spawn
from client.readiness import wait_until_ready
from client.supervisor import SupervisorState, open_deployment, read_state
from client.tables import format_cells, format_services
from common.errors import AlreadyRunning, InvalidValue, NodeTimeout, NotWritable

STOP_DEADLINE_S = 15.0
"""More than the supervisor's own grace before it kills."""


def up(command: Up) -> int:
    """Start a deployment, detached or in the foreground, and show its services."""
    deployment = _plan(command)
    if command.compose:
        return compose_up(command)
    if read_state(deployment.data) is not None:
        raise AlreadyRunning("a deployment", str(deployment.data))
    deployment.check_ports()
    return _stay(deployment) if command.foreground else _detach(deployment)


def down(command: Down) -> int:
    """Stop the deployment of a data folder, or that of Compose."""
    if command.compose:
        return compose_down()
    data = command.data.resolve()
    state = read_state(data)
    if state is None:
        sys.stdout.write(f"nothing runs in {data}\n")
        return 0
    _stop(state)
    sys.stdout.write("stopped\n")
    return 0


def status(command: Status) -> int:
    """Show the services of a control plane."""
    with LegatoClient(command.url) as client:
        services, cells, ready = client.services(), client.cells(), client.ready()
    if command.json:
        shown = {
            "ready": ready,
            "services": [each.model_dump(mode="json") for each in services],
            "cells": [each.model_dump(mode="json") for each in cells],
        }
        sys.stdout.write(json.dumps(shown) + "\n")
    else:
        tables = f"{format_services(services)}\n\n{format_cells(cells)}"
        sys.stdout.write(f"{tables}\n{'ready' if ready else 'NOT READY'}\n")
    return 0


def _plan(command: Up) -> Deployment:
    try:
        return Deployment(
            robots=command.robot or Deployment.model_fields["robots"].default,
            cells=command.cells,
            rest_port=command.port,
            router_port=command.router_port,
            namespace=command.namespace,
            # The supervisor outlives the shell's folder.
            data=command.data.resolve(),
            checkpoints=_find_folder("--checkpoints", command.checkpoints),
            certs=_find_folder("--certs", command.certs),
            log_level=command.log_level,
            lease_s=command.lease_s,
            metrics_port=command.metrics_port,
        )
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        option = {"robots": "robot", "rest_port": "port"}.get(str(first["loc"][0]))
        name = option or str(first["loc"][0]).replace("_", "-")
        raise InvalidValue(f"--{name}", first["input"], first["msg"]) from error


def _find_folder(option: str, folder: Path | None) -> Path | None:
    if folder is not None and not folder.is_dir():
        raise InvalidValue(option, str(folder), "a folder")
    return None if folder is None else folder.resolve()


def _stay(deployment: Deployment) -> int:
    with open_deployment(deployment) as supervisor:
        supervisor.start()
        _show_when_ready(deployment, lambda: supervisor.given_up)
        stop = threading.Event()
        stop_on_signals(stop)
        sys.stdout.write("stop with Ctrl-C\n")
        sys.stdout.flush()
        stop.wait()
    return 0


def _detach(deployment: Deployment) -> int:
    supervisor = _start_supervisor(deployment)
    try:
        _show_when_ready(deployment, lambda: _read_given_up(deployment, supervisor))
    except BaseException:
        # Ctrl-C too: half a deployment helps nobody.
        supervisor.terminate()
        supervisor.wait()
        raise
    sys.stdout.write(f"logs in {deployment.logs}; stop with: legato down\n")
    # It is meant to outlive this process: nobody waits for it.
    supervisor.returncode = 0
    return 0


def _start_supervisor(deployment: Deployment) -> subprocess.Popen[bytes]:
    try:
        deployment.logs.mkdir(parents=True, exist_ok=True)
        with (deployment.logs / "supervisor.log").open("ab") as output:
            return spawn("client.supervisor", (deployment.model_dump_json(),), output)
    except OSError as error:
        raise NotWritable(str(deployment.logs), error.strerror or str(error)) from error


def _read_given_up(
    deployment: Deployment, supervisor: subprocess.Popen[bytes]
) -> Mapping[str, str]:
    if supervisor.poll() is not None:
        return {"supervisor": read_last_line(deployment.logs / "supervisor.log")}
    state = read_state(deployment.data)
    return {} if state is None else state.given_up


def _show_when_ready(deployment: Deployment, given_up: Callable[[], Mapping[str, str]]) -> None:
    with LegatoClient(deployment.url) as client:
        services = wait_until_ready(client, deployment, given_up=given_up)
    sys.stdout.write(f"{format_services(services)}\nready at {deployment.url}\n")
    sys.stdout.flush()


def _stop(state: SupervisorState) -> None:
    os.kill(state.pid, signal.SIGTERM)
    deadline_s = time.monotonic() + STOP_DEADLINE_S
    while read_state(state.deployment.data) is not None:
        if time.monotonic() > deadline_s:
            raise NodeTimeout("supervisor", "end", STOP_DEADLINE_S)
        time.sleep(0.05)
