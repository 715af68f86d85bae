"""Whether robomimic trains on exported data, and how fast LEGATO's training is beside it.

Run: python -m benchmarks.versus_robomimic FOLDER [--rounds 3] [--check-only]

FOLDER is a recorded data set, e.g. runs/demonstrations/lid-abstract-0. Makes robomimic's
environment when it is missing (see requirements.txt). All contestants run once per round, each in
a fresh process, in an order that turns with the rounds.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median

from benchmarks.environments import ensure_environment
from benchmarks.machine import describe_machine
from benchmarks.subset import copy_episodes
from benchmarks.versus_robomimic.contestants import (
    PACKAGE,
    Contestant,
    ContestantFailed,
    Measured,
    make_legato,
    make_robomimic,
    run_child,
    run_in,
)
from common.datasets import EpisodeStore
from common.formats.robomimic import export_robomimic

REQUIREMENTS = Path(__file__).with_name("requirements.txt")
CHECK_EPISODES = 11
SPEED_EPISODES = 2
COMPACT = "legato-compact"
ASKED = {"LEGATO bc-rnn-paper, bf16": 2.0, f"LEGATO {COMPACT}, bf16": 20.0}
RULES = """\
robomimic  BC-RNN with GMM as the paper has it: two ResNet18 (one channel, 128 px) with spatial
           softmax, LSTM 2 x 400, MLP 3 x 2048, 5 modes; its own loader (all windows in memory),
           loop and Adam. It trains in float32 only.
LEGATO     the trainer of `legato train` with its own loader, image variation and losses;
           bc-rnn-paper is the same network with the same inputs.
both       the same episodes, 16 windows of 20 frames per update, one update before timing.
figures    timesteps (stereo pairs) per second: median (least-largest) over rounds. CPU time is
           that of all threads of the process.
"""


def check_training(python: Path, store: EpisodeStore, work: Path) -> bool:
    """Let robomimic's own script train on an export; whether its losses are finite and fall."""
    data = work / "three_channels.hdf5"
    export_robomimic(store, data)
    command = run_in(python, "train_check", str(data), str(work / "trained"))
    losses = json.loads(run_child(command))
    for kind, values in losses.items():
        told = ", ".join(f"{value:.3f}" for value in values)
        print(f"robomimic's training script on the export: {kind} loss per epoch {told}")
    train = losses["Train"]
    finite = all(math.isfinite(value) for values in losses.values() for value in values)
    return finite and len(train) > 1 and train[-1] < train[0]


def run_rounds(
    contestants: Sequence[Contestant], *, rounds: int
) -> dict[Contestant, list[Measured]]:
    """Run every contestant once per round, so that a slow phase of the machine hits them all."""
    measured: dict[Contestant, list[Measured]] = {each: [] for each in contestants}
    for index in range(rounds):
        first = index % len(contestants)
        for contestant in (*contestants[first:], *contestants[:first]):
            print(f"round {index + 1}/{rounds}: {contestant.name}", file=sys.stderr)
            measured[contestant].append(contestant.run())
    return measured


def print_table(rounds: Mapping[Contestant, Sequence[Measured]], reference: Contestant) -> None:
    """Rates, ratios round by round, and whether they are what is asked for."""
    head = ("parameters", "timesteps/s", "per CPU second", "x wall", "x CPU")
    print(f"{'':30s}{head[0]:>12s}{head[1]:>24s}{head[2]:>24s}{head[3]:>20s}{head[4]:>20s}")
    for contestant, measured in rounds.items():
        pairs = list(zip(measured, rounds[reference], strict=True))
        wall = [one.per_wall / other.per_wall for one, other in pairs]
        cpu = [one.per_cpu / other.per_cpu for one, other in pairs]
        print(
            f"{contestant.name:30s}{measured[0].parameters / 1e6:>10.2f} M"
            f"{describe([m.per_wall for m in measured]):>24s}"
            f"{describe([m.per_cpu for m in measured]):>24s}"
            f"{describe(wall):>20s}{describe(cpu):>20s}"
        )
        if contestant.name in ASKED:
            asked = ASKED[contestant.name]
            verdict = "met" if median(wall) >= asked else "NOT met"
            print(f"{'':30s}asked: {asked:g} x by wall time: {verdict}")


def describe(values: Sequence[float]) -> str:
    """Median, least and largest."""
    return f"{median(values):.1f} ({min(values):.1f}-{max(values):.1f})"


def main() -> int:
    """Check, measure and print."""
    parser = argparse.ArgumentParser(prog=PACKAGE, description=__doc__)
    parser.add_argument("folder", type=Path, help="of a data set")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--updates", type=int, default=3, help="of the paper's network per round")
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--check-only", action="store_true", help="do not measure speed")
    args = parser.parse_args()

    python = ensure_environment(".venv-robomimic", REQUIREMENTS, size="1 GB")
    print(describe_machine(("torch", "numpy", "h5py")))
    with tempfile.TemporaryDirectory() as temporary:
        work, store = Path(temporary), EpisodeStore.open(args.folder)
        try:
            trains = check_training(
                python, copy_episodes(store, work / "check", CHECK_EPISODES), work
            )
            if args.check_only or not trains:
                return 0 if trains else 1
            some = copy_episodes(store, work / "speed", SPEED_EPISODES)
            rounds = measure(python, some, work, args)
        except ContestantFailed as error:
            raise SystemExit(str(error)) from error
    reference = next(iter(rounds))
    versions = rounds[reference][0].versions
    print("robomimic runs with " + ", ".join(f"{name} {v}" for name, v in versions.items()))
    print(f"\n{RULES}\n{args.rounds} rounds, {args.threads} threads, {some.rows} rows\n")
    print_table(rounds, reference)
    return 0


def measure(
    python: Path, store: EpisodeStore, work: Path, args: argparse.Namespace
) -> dict[Contestant, list[Measured]]:
    """Export the episodes and run all contestants; the first one is robomimic."""
    data = work / "one_channel.hdf5"
    export_robomimic(store, data, channels=1)
    updates, threads = args.updates, args.threads
    contestants = [make_robomimic(python, data, work, updates=updates, threads=threads)]
    for preset, precision, factor in (
        ("bc-rnn-paper", "fp32", 1),
        ("bc-rnn-paper", "bf16", 1),
        (COMPACT, "bf16", 20),
    ):
        contestants.append(
            make_legato(
                store.folder,
                preset=preset,
                precision=precision,
                updates=factor * updates,
                threads=threads,
            )
        )
    return run_rounds(contestants, rounds=args.rounds)


if __name__ == "__main__":
    sys.exit(main())
