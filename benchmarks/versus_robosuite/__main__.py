"""Speed of LEGATO's full loop beside robosuite's Lift task, on one machine in one run.

Run: python -m benchmarks.versus_robosuite [--rounds 3] [--seconds 10] [--trials 3]

Makes robosuite's environment when it is missing (see requirements.txt). Its cameras need OpenGL
that draws without a screen; on Debian: apt-get install libegl1 libgl1 libgl1-mesa-dri libosmesa6.
All contestants run once per round, each in a fresh process, in an order that turns with the rounds.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.machine import describe_machine
from benchmarks.versus_robosuite.contestants import (
    GL_PACKAGES,
    Contestant,
    ContestantFailed,
    Measured,
    make_legato,
    make_lift,
    make_lift_drawing,
)
from benchmarks.versus_robosuite.environment import ensure_environment
from benchmarks.versus_robosuite.table import describe_verdict, print_factors, print_ratios

PROBE_S = 0.5
PACKAGES = ("mujoco-core", "pin", "piqp", "numpy", "numba", "eclipse-zenoh")
RULES = """\
robosuite  Lift with the Panda, random actions at 10 Hz, physics and controller at 500 Hz; two
           128 x 128 cameras at 10 Hz (agentview, eye in hand). Only env.step is timed; "with
           resets" adds one reset per episode.
LEGATO     lid task with the Panda, expert, physics at 500 Hz, retargeting and gripper at 100 Hz,
           one 128 x 128 fisheye pair with shadows at 10 Hz. Timed from trial to trial: set-up,
           scheduling and the result are always in it.
threads    OMP, OPENBLAS, NUMBA and LP_NUM_THREADS = 1, except where a row says otherwise.
figures    simulated seconds per second: median (least-largest) over rounds. CPU time is that of
           all threads of the process.
"""


def choose_drawing(python: Path, *, seconds: float) -> list[Contestant]:
    """The contestants with cameras that can draw here; says what is missing for the others."""
    libraries: list[str] = []
    for gl, packages in GL_PACKAGES.items():
        try:
            probe = make_lift_drawing(python, gl=gl, seconds=PROBE_S).run(seed=0)
        except ContestantFailed as error:
            print(f"{gl}: left out, {error} (Debian: apt-get install {packages})")
            continue
        print(f"{gl}: draws with {probe.renderer}")
        libraries.append(gl)
    drawing = [make_lift_drawing(python, gl=gl, seconds=seconds) for gl in libraries]
    many = [
        make_lift_drawing(python, gl=gl, seconds=seconds, one_thread=False) for gl in libraries[:1]
    ]
    return drawing + many


def run_rounds(
    contestants: Sequence[Contestant], *, rounds: int
) -> dict[Contestant, list[Measured]]:
    """Run every contestant once per round, so that a slow phase of the machine hits them all.

    Raises:
        SystemExit: One of them ended with an error.
    """
    measured: dict[Contestant, list[Measured]] = {each: [] for each in contestants}
    for index in range(rounds):
        first = index % len(contestants)
        for contestant in (*contestants[first:], *contestants[:first]):
            print(f"round {index + 1}/{rounds}: {contestant.name}", file=sys.stderr)
            try:
                measured[contestant].append(contestant.run(seed=index))
            except ContestantFailed as error:
                raise SystemExit(f"{contestant.name}: {error}") from error
    return measured


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="benchmarks.versus_robosuite", description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=10.0, help="simulated, of a Lift episode")
    parser.add_argument("--trials", type=int, default=3, help="of LEGATO per round, after one more")
    args = parser.parse_args()

    python = ensure_environment()
    print(describe_machine(PACKAGES))
    legato, lift = make_legato(trials=args.trials), make_lift(python, seconds=args.seconds)
    drawing = choose_drawing(python, seconds=args.seconds)
    rounds = run_rounds([lift, *drawing, legato], rounds=args.rounds)
    versions = rounds[lift][0].versions
    print("robosuite runs with " + ", ".join(f"{name} {v}" for name, v in versions.items()))
    print(
        f"\n{RULES}\n{args.rounds} rounds; episodes of {args.seconds:g} s, "
        f"{args.trials} LEGATO trials per round\n"
    )
    print_factors(rounds)
    print()
    print_ratios(rounds, legato)
    print("\n" + describe_verdict(rounds, legato))
    return 0


if __name__ == "__main__":
    sys.exit(main())
