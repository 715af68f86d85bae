"""Speed of a learned policy: one cell, and eight cells of one policy service.

Run: python -m benchmarks.inference [--size compact --size paper] [--rounds 200] [--threads 2]

From a stereo frame to an action, through the reactor of the policy service, without the bus. The
weights are random: the time does not depend on them. One and eight cells take turns; medians are
printed, of wall time and of the processor time that all threads of this process took. The speed of
large matrix products on one core, measured just before, says how fast that core was allowed to be:
an encoder does not get beyond it.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from statistics import median

import numpy as np
import torch

from benchmarks.machine import describe_machine
from common.messages import EpisodeConfigure, Header, PolicyAction, StereoFrame
from services.policy.learning.checkpoint import (
    CheckpointCard,
    CheckpointConfig,
    DatasetSummary,
    ImageSpec,
    load_checkpoint,
    save_checkpoint,
)
from services.policy.learning.network import PolicyNetwork
from services.policy.learning.normalization import ActionStatistics
from services.policy.learning.presets import load_preset
from services.policy.reactor import PolicyReactor
from services.policy.serving.backend import StepInput, StepOutput
from services.policy.serving.library import Library, ServingOptions, open_backend

CELLS = 8
COMPARED_STEPS = 20
PRODUCT_SIZE = 1024


def main() -> int:
    """Measure each size on each backend."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", action="append", help="preset (default: compact and paper)")
    parser.add_argument("--rounds", type=int, default=200, help="(%(default)s)")
    parser.add_argument("--threads", type=int, default=2, help="of the last row (%(default)s)")
    args = parser.parse_args()
    torch.set_num_threads(1)
    print(describe_machine(["onnxruntime", "torch", "numpy"]))
    print(
        f"\n{'':26s}{'one cell':>20s}{f'{CELLS} cells, each':>20s}{'throughput':>12s}\n"
        f"{'':26s}" + f"{'wall':>10s}{'CPU':>10s}" * 2 + f"{'x one':>12s}"
    )
    with tempfile.TemporaryDirectory() as folder:
        for size in args.size or ("compact", "paper"):
            measure_size(Path(folder), size, rounds=args.rounds, threads=args.threads)
    return 0


def measure_size(base: Path, size: str, *, rounds: int, threads: int) -> None:
    """Print the rows of one size."""
    folder = write_random_checkpoint(base / size, preset=f"legato-{size}")
    print(f"{'one core, products':26s}{measure_core():7.0f} GFLOP/s")
    options = {
        "onnx": ServingOptions(),
        f"onnx, {threads} threads": ServingOptions(threads=threads),
        "torch": ServingOptions(backend="torch"),
    }
    for name, each in options.items():
        library = Library(each)
        library.load("learned", folder)
        one, many = time_cells(library, rounds=rounds)
        cells = "".join(
            f"{1e3 * wall / count:7.2f} ms{1e3 * cpu / count:7.2f} ms"
            for (wall, cpu), count in ((one, 1), (many, CELLS))
        )
        print(f"{size + ' ' + name:26s}{cells}{CELLS * one[0] / many[0]:12.2f}")
    print(f"{size + ' onnx - torch':26s}{compare(folder):10.1e} at most, {COMPARED_STEPS} steps")


def measure_core() -> float:
    """Median speed of square float32 products on one thread [GFLOP/s], by processor time."""
    left, right = torch.rand(2, PRODUCT_SIZE, PRODUCT_SIZE)
    times: list[float] = []
    for _ in range(20):
        started = time.process_time()
        torch.mm(left, right)
        times.append(time.process_time() - started)
    return 2e-9 * PRODUCT_SIZE**3 / median(times)


def write_random_checkpoint(folder: Path, *, preset: str) -> Path:
    """A checkpoint of a preset with random weights."""
    torch.manual_seed(0)
    network = PolicyNetwork(load_preset(preset))
    actions = np.random.default_rng(0).normal(0.0, 0.01, size=(100, 6))
    save_checkpoint(
        folder,
        network,
        config=CheckpointConfig(
            network=load_preset(preset),
            image=ImageSpec(px=network.config.encoder.input_px),
            tasks=("lid",),
            seed=0,
        ),
        statistics=ActionStatistics.of(actions),
        card=CheckpointCard(
            command="none: random weights",
            created=datetime.now(UTC),
            versions={},
            git_revision=None,
            dataset=DatasetSummary(sha256="0" * 64, episodes=0, frames=0, robots=()),
            steps=0,
            timesteps=0,
            minutes=0.0,
            losses={},
        ),
    )
    return folder


def time_cells(library: Library, *, rounds: int) -> tuple[tuple[float, float], tuple[float, float]]:
    """Median wall and processor time of one cell's frame, and of a frame of each of eight [s]."""
    reactor = PolicyReactor(node="policy", library=library)
    for cell in range(CELLS):
        reactor.handle([make_configure(cell)])
    frames = make_frames()
    times: dict[int, list[tuple[float, float]]] = {1: [], CELLS: []}
    for _ in range(rounds):
        for count, taken in times.items():
            asked = [next(frames[cell]) for cell in range(count)]
            wall, cpu = time.perf_counter(), time.process_time()
            said = list(reactor.handle(asked))
            taken.append((time.perf_counter() - wall, time.process_time() - cpu))
            if len(said) != count or not all(isinstance(each, PolicyAction) for each in said):
                raise RuntimeError(f"{count} frames were answered by {said}")
    one, many = ([median(column) for column in zip(*times[n], strict=True)] for n in (1, CELLS))
    return (one[0], one[1]), (many[0], many[1])


def make_configure(cell: int) -> EpisodeConfigure:
    """An episode of a cell."""
    return EpisodeConfigure(
        header=Header(cell=f"sim-{cell}", epoch=1),
        task="lid",
        robot="abstract",
        policy="learned",
        seed=cell,
        mode="lockstep",
        nodes={"sim": f"sim-{cell}", "policy": "policy"},
    )


def make_frames() -> list[Iterator[StereoFrame]]:
    """Endless frames of noise, per cell."""
    random = np.random.default_rng(0)

    def of(cell: int) -> Iterator[StereoFrame]:
        left, right = (random.integers(0, 256, 128 * 128, dtype=np.uint8) for _ in range(2))
        step = 0
        while True:
            yield StereoFrame(
                header=Header(cell=f"sim-{cell}", epoch=1, source=f"sim-{cell}", step=step),
                camera="t265",
                width=128,
                height=128,
                left=left.tobytes(),
                right=right.tobytes(),
                due_step=step,
            )
            step += 10

    return [of(cell) for cell in range(CELLS)]


def compare(folder: Path) -> float:
    """Largest difference between ONNX Runtime and torch over steps that hand the state on."""
    checkpoint = load_checkpoint(folder)
    random = np.random.default_rng(0)
    onnx, reference = (
        open_backend(checkpoint, ServingOptions(backend=kind)) for kind in ("onnx", "torch")
    )
    blank = StepInput.blank(checkpoint.config.network, cells=1)
    states = [(blank.h, blank.c)] * 2
    largest = 0.0
    for _ in range(COMPARED_STEPS):
        images = random.integers(0, 256, size=blank.images.shape, dtype=np.uint8)
        said: list[StepOutput] = [
            backend.run(StepInput(images, blank.history, h, c))
            for backend, (h, c) in zip((onnx, reference), states, strict=True)
        ]
        states = [(each.h, each.c) for each in said]
        for name in ("log_weights", "means", "grasp_logit", "h", "c"):
            difference = np.abs(getattr(said[0], name) - getattr(said[1], name))
            largest = max(largest, float(difference.max()))
    return largest


if __name__ == "__main__":
    sys.exit(main())
