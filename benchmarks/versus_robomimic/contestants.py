"""What is measured: each contestant is one child process that prints one JSON object."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.environments import ROOT

# A thread that waits for another by spinning starves it on cores that others use too; the same
# for everybody.
SETTINGS = {"OMP_WAIT_POLICY": "PASSIVE"}
PACKAGE = "benchmarks.versus_robomimic"


class ContestantFailed(Exception):
    """A child process ended without a measurement; the text is why."""


@dataclass(frozen=True)
class Measured:
    """One measurement, as the child process printed it."""

    timesteps: int
    wall_s: float
    cpu_s: float
    parameters: int
    loss: float
    versions: Mapping[str, str] = field(default_factory=dict[str, str])

    @property
    def per_wall(self) -> float:
        """Timesteps per second."""
        return self.timesteps / self.wall_s

    @property
    def per_cpu(self) -> float:
        """Timesteps per CPU second of all threads."""
        return self.timesteps / self.cpu_s


@dataclass(frozen=True, eq=False)
class Contestant:
    """A command and its name in the table."""

    name: str
    command: Sequence[str]

    def run(self) -> Measured:
        """Start the child process and read what it measured.

        Raises:
            ContestantFailed: It ended with an error, or did not learn.
        """
        measured = Measured(**json.loads(run_child(self.command)))
        if not math.isfinite(measured.loss):
            raise ContestantFailed(f"{self.name}: its loss is {measured.loss}")
        return measured


def run_child(command: Sequence[str]) -> str:
    """The last line that a child process prints.

    Raises:
        ContestantFailed: It ended with an error.
    """
    ended = subprocess.run(
        command, env=os.environ | SETTINGS, cwd=ROOT, capture_output=True, text=True, check=False
    )
    if ended.returncode != 0:
        raise ContestantFailed((ended.stderr.strip().splitlines() or ["no error text"])[-1])
    # Libraries may print before it.
    return ended.stdout.splitlines()[-1]


def run_in(python: Path, module: str, *arguments: str) -> tuple[str, ...]:
    """The command that runs a module of this folder in robomimic's environment."""
    start = (str(python), "-m", "benchmarks.torchvision_operators")
    return (*start, f"{PACKAGE}.{module}", *arguments)


def make_robomimic(
    python: Path, data: Path, work: Path, *, updates: int, threads: int
) -> Contestant:
    """BC-RNN of robomimic with the paper's network."""
    command = run_in(python, "speed_robomimic", str(data), str(work))
    counts = ("--updates", str(updates), "--threads", str(threads))
    return Contestant("robomimic BC-RNN, fp32", (*command, *counts))


def make_legato(
    folder: Path, *, preset: str, precision: str, updates: int, threads: int
) -> Contestant:
    """LEGATO's trainer with one of its presets."""
    command = (sys.executable, "-m", f"{PACKAGE}.speed_legato", str(folder))
    choices = ("--preset", preset, "--precision", precision)
    counts = ("--updates", str(updates), "--threads", str(threads))
    return Contestant(f"LEGATO {preset}, {precision}", (*command, *choices, *counts))
