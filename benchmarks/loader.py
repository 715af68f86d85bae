"""Frames per second that the training's loader gathers, beside what the memory allows.

Run: python -m benchmarks.loader [FOLDER] [--updates 200] [--threads 2]

FOLDER is a recorded data set; without one, a data set of noise is made for the time of the run, as
large as 150 demonstrations. Random windows of 20 frames in batches of 16, with all
columns that an update needs. "plain" are the windows as they are, "varied" are moved and changed in
gray level: the batches of `legato train`. "copy" is numpy copying the same images, window by
window, and nothing else. "varied, 2 threads" are those of `legato train --threads 2`. All take
turns in every update; medians. The time on the processor, of all threads, leaves out what other
programs take of it. Where robomimic's environment exists
(`python -m benchmarks.versus_robomimic` makes it), its loader is measured too.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median

import numpy as np

from benchmarks.environments import ROOT
from benchmarks.machine import describe_machine
from benchmarks.subset import copy_episodes
from benchmarks.versus_robomimic.contestants import run_child, run_in
from common.datasets import (
    DatasetSpec,
    EpisodeMetadata,
    EpisodeRows,
    EpisodeStore,
    EpisodeWriter,
    Rows,
)
from common.formats.robomimic import export_robomimic
from services.policy.learning.presets import load_preset
from services.policy.training.config import TrainingConfig
from services.policy.training.data import TrainingData, load_training_data
from services.policy.training.windows import WindowLoader
from services.recorder.columns import describe_dataset

ASKED = 500_000
EPISODES, LENGTH = 150, 140
ROBOMIMIC = ROOT / ".venv-robomimic" / "bin" / "python"
ROBOMIMIC_EPISODES = 2
"""Its cache holds every frame once per window that contains it."""
ROBOMIMIC_UPDATES = 20
ROBOMIMIC_CACHES = {"all": "all windows in memory", "low_dim": "images from the file"}
PRESETS = {64: "legato-small", 128: "legato-compact"}

Times = Sequence[tuple[float, float]]
"""Wall time and time on the processor, of all threads, of each update [s]."""


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="benchmarks.loader", description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", help="of a data set")
    parser.add_argument("--updates", type=int, default=200, help="(%(default)s)")
    parser.add_argument("--threads", type=int, default=2, help="of the last rows (%(default)s)")
    args = parser.parse_args()
    print(describe_machine(["numba", "numpy", "torch"]))
    with tempfile.TemporaryDirectory() as temporary:
        work = Path(temporary)
        store = EpisodeStore.open(args.folder or write_noise(work / "noise"))
        print(f"{len(store)} episodes, {store.rows} rows; asked: {ASKED:,} frames/s")
        print(f"\n{'frames per second':34s}{'by wall time':>14s}{'by CPU time':>14s}{'GB/s':>8s}")
        for px in PRESETS:
            measure(store.folder, px, updates=args.updates, threads=args.threads)
        if ROBOMIMIC.is_file():
            measure_robomimic(ROBOMIMIC, store, work)
        else:
            print("robomimic is left out: its environment has not been made")
    return 0


def write_noise(folder: Path) -> Path:
    """A data set of noise; what it shows does not change the time."""
    spec = describe_dataset(task="lid", robot="abstract", camera="t265", recording={}, software={})
    random = np.random.default_rng(0)
    with EpisodeWriter.open(folder, spec) as writer:
        for number in range(EPISODES):
            metadata = EpisodeMetadata(trial=number, seed=number, outcome="success", details={})
            writer.append(make_rows(spec, random), metadata)
    return folder


def make_rows(spec: DatasetSpec, random: np.random.Generator) -> EpisodeRows:
    """An episode of random bytes, switches and motions."""
    columns: dict[str, Rows] = {}
    for column in spec.columns:
        shape = (LENGTH, *column.shape)
        if np.issubdtype(column.numpy_dtype, np.floating):
            columns[column.name] = random.normal(0.0, 0.01, shape).astype(column.numpy_dtype)
        else:
            below = 256 if column.name == "images" else 2
            columns[column.name] = random.integers(0, below, shape, column.numpy_dtype)
    return EpisodeRows(columns)


def measure(folder: Path, px: int, *, updates: int, threads: int) -> None:
    """Print the rows of one size of images."""
    config = TrainingConfig(
        network=load_preset(PRESETS[px]), validation_share=0.0, longest_episode_s=1e3
    )
    data = load_training_data([folder], config)
    loader = WindowLoader(data, config)
    window, batch = config.network.window, config.batch_windows

    def plain(update: int) -> None:
        loader.gather(loader.draw(np.random.default_rng(update), batch))

    ways: dict[str, Callable[[int], object]] = {
        "copy": make_copy(data, loader, window=window, batch=batch),
        "plain": plain,
        "varied": loader.batch,
        f"varied, {threads} threads": WindowLoader(data, config, threads=threads).batch,
    }
    times = take_turns(list(ways.values()), updates=updates)
    for name, taken in zip(ways, times, strict=True):
        print_row(f"{px} px, {name}", taken, frames=window * batch, px=px)


def make_copy(
    data: TrainingData, loader: WindowLoader, *, window: int, batch: int
) -> Callable[[int], None]:
    """Copies images as they are, to the same place every time."""
    target = np.zeros((batch, window, 2, data.frames.px, data.frames.px), np.uint8)

    def copy(update: int) -> None:
        rows = loader.draw(np.random.default_rng(update), batch)
        for part, source in zip(target, data.frames.windows(rows, window), strict=True):
            np.copyto(part, source)

    return copy


def take_turns(functions: Sequence[Callable[[int], object]], *, updates: int) -> list[Times]:
    """Times of each function, update by update; the first tenth, which warms up, is left out."""
    times: list[list[tuple[float, float]]] = [[] for _ in functions]
    for update in range(updates):
        for function, taken in zip(functions, times, strict=True):
            began_s, began_cpu_s = time.perf_counter(), time.process_time()
            function(update)
            taken.append((time.perf_counter() - began_s, time.process_time() - began_cpu_s))
    return [taken[updates // 10 :] for taken in times]


def measure_robomimic(python: Path, store: EpisodeStore, work: Path) -> None:
    """Print the rows of robomimic's loader, which varies nothing."""
    data = work / "one_channel.hdf5"
    export_robomimic(copy_episodes(store, work / "few", ROBOMIMIC_EPISODES), data, channels=1)
    for cache, told in ROBOMIMIC_CACHES.items():
        counts = ("--cache", cache, "--updates", str(ROBOMIMIC_UPDATES))
        command = run_in(python, "speed_loader", str(data), str(work / cache), *counts)
        measured = json.loads(run_child(command))
        name = f"robomimic, {told}"
        print_row(name, measured["times"], frames=measured["frames"], px=128)


def print_row(name: str, times: Times, *, frames: int, px: int) -> None:
    """Rates by the median times."""
    wall, cpu = (frames / median(column) for column in zip(*times, strict=True))
    print(f"{name:34s}{wall:>14,.0f}{cpu:>14,.0f}{wall * 2 * px * px / 1e9:>8.2f}")


if __name__ == "__main__":
    sys.exit(main())
