"""Compose projects for tests: started under a name of their own, removed in every case."""

from __future__ import annotations

import json
import os
import secrets
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]

UP_S = 300
BUILD_S = 3600


def why_not() -> str | None:
    """What is missing for containers here, or None."""
    if shutil.which("docker") is None:
        return "there is no docker command"
    for what, arguments in (
        ("there is no Compose v2", ("compose", "version")),
        ("there is no container engine that answers", ("version",)),
    ):
        done = subprocess.run(["docker", *arguments], capture_output=True, text=True, timeout=60)
        if done.returncode != 0:
            return f"{what}: {done.stderr.strip() or done.stdout.strip()}"
    return None


def docker(*arguments: str) -> str:
    """Standard output of a docker command that must succeed."""
    done = subprocess.run(["docker", *arguments], capture_output=True, text=True, timeout=UP_S)
    assert done.returncode == 0, done.stderr
    return done.stdout


def gateway() -> str:
    """Address of this machine that containers of every network reach."""
    return docker(
        "network", "inspect", "bridge", "--format", "{{(index .IPAM.Config 0).Gateway}}"
    ).strip()


@dataclass(frozen=True)
class Project:
    """One Compose project.

    Args:
        files: Its Compose files.
        env: What the files are filled in with.
        name: Prefix of its containers, networks and volumes.
    """

    files: tuple[str, ...] = ("compose.yaml",)
    env: dict[str, str] = field(default_factory=dict[str, str])
    name: str = field(default_factory=lambda: f"legato-test-{secrets.token_hex(4)}")

    def run(self, *arguments: str, timeout_s: int = UP_S) -> subprocess.CompletedProcess[str]:
        """Run `docker compose` on it."""
        files = [f"--file={file}" for file in self.files]
        return subprocess.run(
            ["docker", "compose", f"--project-name={self.name}", *files, *arguments],
            cwd=ROOT,
            env=os.environ | self.env,
            capture_output=True,
            text=True,
            timeout=timeout_s,
        )

    def compose(self, *arguments: str, timeout_s: int = UP_S) -> str:
        """Standard output of a `docker compose` that must succeed."""
        done = self.run(*arguments, timeout_s=timeout_s)
        assert done.returncode == 0, f"{done.stderr}\n{self.logs()}"
        return done.stdout

    def inside(self, service: str, command: str) -> str:
        """Standard output of a shell command in a container, which must succeed."""
        return self.compose("exec", "-T", service, "sh", "-c", command)

    def up(self, *arguments: str) -> None:
        """Start it and wait until every container is healthy."""
        self.compose("up", "--detach", "--wait", "--no-build", *arguments)

    def logs(self) -> str:
        """The end of what every container has said."""
        return self.run("logs", "--no-color", "--tail=20").stdout

    def containers(self, service: str | None = None) -> list[dict[str, Any]]:
        """What the engine knows of the containers of one service, or of all."""
        ids = self.compose("ps", "--all", "--quiet", *([service] if service else [])).split()
        return json.loads(docker("inspect", *ids)) if ids else []

    def config(self) -> dict[str, Any]:
        """The filled in Compose files."""
        return json.loads(self.compose("config", "--format=json"))


def build(target: str, folder: Path, *, context: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """Build one target of a Dockerfile, as `compose.yaml` builds its own.

    Args:
        target: Stage of the Dockerfile; the image becomes `legato-TARGET`.
        folder: Empty folder for a Compose file.
        context: Folder of the Dockerfile.
    """
    ours = Project().config()
    arguments = {**ours["services"]["router"]["build"], "context": str(context), "target": target}
    service = {"image": f"legato-{target}", "build": arguments}
    file = folder / "compose.json"
    file.write_text(json.dumps({"services": {target: service}, "secrets": ours["secrets"]}))
    return Project(files=(str(file),)).run("build", timeout_s=BUILD_S)


@contextmanager
def started(project: Project, *arguments: str) -> Iterator[Project]:
    """Start a project; in the end remove its containers, networks and volumes."""
    try:
        project.up(*arguments)
        yield project
    finally:
        project.run("down", "--volumes", "--remove-orphans", "--timeout=10")
