"""`legato up --compose` and `legato down --compose`, as users type them."""

from __future__ import annotations

import os
import secrets
import subprocess
import sys

import pytest

from client.api import LegatoClient
from client.deployment import find_free_ports
from tests.compose.projects import ROOT, Project

pytestmark = pytest.mark.compose


@pytest.mark.usefixtures("images")
def test_the_command_line_starts_and_stops_the_containers():
    rest_port, router_port = find_free_ports(2)
    project = Project(name=f"legato-test-{secrets.token_hex(4)}")
    options = (f"--port={rest_port}", f"--router-port={router_port}", "--cells=2", "--robot=spot")
    try:
        started = legato(project, "up", "--compose", *options)
        assert started.returncode == 0, started.stderr
        with LegatoClient(f"http://127.0.0.1:{rest_port}", timeout_s=30.0) as client:
            nodes = [node for node in client.services() if node.alive]
        kinds = [node.kind for node in nodes]
        robots = {each for n in nodes if n.kind == "retarget" for each in n.offers["robots"]}
        assert kinds.count("sim") == 2
        assert robots == {"abstract", "panda", "spot"}
        stopped = legato(project, "down", "--compose")
        assert stopped.returncode == 0, stopped.stderr
        assert project.run("ps", "--all", "--quiet").stdout.split() == []
    finally:
        project.run("--profile=*", "down", "--volumes", "--timeout=10")


def legato(project: Project, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "client.main", *arguments],
        cwd=ROOT,
        env=os.environ | {"COMPOSE_PROJECT_NAME": project.name},
        capture_output=True,
        text=True,
        timeout=400,
    )
