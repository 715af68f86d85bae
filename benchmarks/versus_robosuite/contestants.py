"""What is measured: each contestant is one child process that prints one JSON object."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.versus_robosuite.environment import ROOT

LIFT = Path(__file__).with_name("lift.py")
LOOP = "benchmarks.versus_robosuite.loop"
ONE_THREAD = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
    "LP_NUM_THREADS": "1",
}
"""LP_NUM_THREADS is that of llvmpipe, Mesa's software renderer."""

GL_PACKAGES = {"egl": "libegl1 libgl1 libgl1-mesa-dri", "osmesa": "libosmesa6"}
"""OpenGL libraries that draw without a screen, and the packages of Debian that have them."""


class ContestantFailed(Exception):
    """A child process ended without a measurement; the text is why."""


@dataclass(frozen=True)
class Measured:
    """One measurement, as the child process printed it."""

    sim_s: float
    wall_s: float
    cpu_s: float
    reset_wall_s: float
    """Wall time of the reset, where it is not in `wall_s`."""
    renderer: str = ""
    """What OpenGL draws with."""
    versions: Mapping[str, str] = field(default_factory=dict[str, str])
    """Packages of robosuite's environment."""

    @property
    def per_wall(self) -> float:
        """Simulated over wall time."""
        return self.sim_s / self.wall_s

    @property
    def per_cpu(self) -> float:
        """Simulated over CPU time of all threads."""
        return self.sim_s / self.cpu_s

    @property
    def with_reset(self) -> float:
        """Simulated over wall time, the reset included."""
        return self.sim_s / (self.wall_s + self.reset_wall_s)


@dataclass(frozen=True, eq=False)
class Contestant:
    """A command and the environment variables that make it what its name says."""

    name: str
    command: Sequence[str]
    settings: Mapping[str, str] = field(default_factory=dict[str, str])
    is_drawing: bool = False
    """Has cameras and one thread: takes part in the comparison that is asked for."""

    def run(self, *, seed: int) -> Measured:
        """Start the child process and read what it measured.

        Raises:
            ContestantFailed: It ended with an error.
        """
        ended = subprocess.run(
            [*self.command, "--seed", str(seed)],
            env=os.environ | self.settings,
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=False,
        )
        if ended.returncode != 0:
            raise ContestantFailed(find_cause(ended.stderr))
        # Libraries may print before it.
        return Measured(**json.loads(ended.stdout.splitlines()[-1]))


def find_cause(stderr: str) -> str:
    """The line that says why a Python process ended: that of the first traceback, or the last."""
    lines = stderr.strip().splitlines() or ["no error text"]
    started = [index for index, line in enumerate(lines) if line.startswith("Traceback")]
    # Later tracebacks are of destructors that stumble over what is half made.
    after = lines[started[0] + 1 :] if started else []
    return next((line for line in after if not line.startswith(" ")), lines[-1])


def make_legato(*, trials: int) -> Contestant:
    """LEGATO's full loop with its stereo pair."""
    return Contestant(
        "LEGATO full loop, stereo pair",
        (sys.executable, "-m", LOOP, "--trials", str(trials)),
        ONE_THREAD,
    )


def make_lift(python: Path, *, seconds: float) -> Contestant:
    """Lift of robosuite without cameras."""
    return Contestant("robosuite Lift, state only", _lift(python, seconds), ONE_THREAD)


def make_lift_drawing(
    python: Path, *, gl: str, seconds: float, one_thread: bool = True
) -> Contestant:
    """Lift of robosuite with two cameras, drawn on the CPU by an OpenGL library."""
    threads = dict(ONE_THREAD)
    if not one_thread:
        threads["LP_NUM_THREADS"] = str(os.cpu_count())
    return Contestant(
        f"robosuite Lift, 2 cameras, {gl}" + ("" if one_thread else f", {os.cpu_count()} threads"),
        (*_lift(python, seconds), "--cameras"),
        {**threads, "MUJOCO_GL": gl, "LIBGL_ALWAYS_SOFTWARE": "1"},
        is_drawing=one_thread,
    )


def _lift(python: Path, seconds: float) -> tuple[str, ...]:
    # Isolated, so that neither this folder nor PYTHONPATH adds modules of LEGATO's environment.
    return (str(python), "-I", str(LIFT), "--seconds", str(seconds))
