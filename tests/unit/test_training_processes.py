"""Several processes train one network. As a program, this file is one of them (see `main`)."""

import json
import os
import subprocess
import sys
import threading
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

from client.main import run
from services.policy.learning.checkpoint import load_checkpoint
from services.policy.learning.config import HistoryConfig
from services.policy.training.config import PretrainingConfig
from services.policy.training.data import load_training_data
from services.policy.training.device import Placement, leave, place
from services.policy.training.run import Intervals, Run, RunResult
from services.policy.training.trainer import PretrainingReport, UpdateReport, ValidationReport
from tests.training_data import FORESEEING, write_dataset

pytestmark = pytest.mark.processes

ROOT = Path(__file__).parents[2]
PRETRAINING, UPDATES = 4, 8
NETWORK = FORESEEING.network.model_copy(update={"history": HistoryConfig(steps=2, dropout=0.5)})
CONFIG = FORESEEING.model_copy(
    update={
        "network": NETWORK,
        "batch_windows": 8,
        "timesteps": 8 * 6 * UPDATES,
        "pretraining": PretrainingConfig(frames=16 * PRETRAINING, batch_frames=16),
    }
)
ENDLESS = 10**9


@dataclass
class Stopper:
    """Sets `stop` after an update."""

    stop: threading.Event
    after: int
    told: int = 0

    def begin(self, *, update: int, updates: int, timesteps_per_update: int) -> None:
        self.told += 1

    def update(self, update: int, report: UpdateReport | PretrainingReport) -> None:
        self.told += 1
        if update >= self.after:
            self.stop.set()

    def validated(self, update: int, report: ValidationReport) -> None:
        self.told += 1


def train(data: Path, folder: Path, placement: Placement, *, after: int) -> tuple[RunResult, int]:
    """Train until it is done or stopped; the result, and how often progress was told."""
    progress = Stopper(threading.Event(), after)
    running = Run(
        folder,
        CONFIG,
        load_training_data([data], CONFIG),
        placement=placement,
        progress=progress,
        intervals=Intervals(log=1, validate=4),
    )
    return running.go_on(progress.stop), progress.told


def main() -> None:
    """One process under torchrun: data set, run, folder of its own, update to stop after."""
    data, folder, seen, after = *(Path(part) for part in sys.argv[1:4]), int(sys.argv[4])
    torch.set_num_threads(1)
    placement = place("cpu")
    try:
        result, told = train(data, folder, placement, after=after)
    finally:
        leave()
    parameters = dict(result.trainer.network.named_parameters())
    save_file(
        {name: value.detach().contiguous() for name, value in parameters.items()},
        seen / f"{placement.rank}.safetensors",
    )
    numbers = {"update": result.update, "told": told, "validated": result.validation is not None}
    (seen / f"{placement.rank}.json").write_text(json.dumps(numbers))


def start(*command: str) -> subprocess.CompletedProcess[str]:
    """Two processes of a module."""
    torchrun = ("-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2", "-m")
    return subprocess.run(
        [sys.executable, *torchrun, *command],
        cwd=ROOT,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
        timeout=600,
    )


@dataclass(frozen=True)
class Pair:
    """What both processes have left."""

    folder: Path
    numbers: list[dict[str, int]]
    weights: list[dict[str, torch.Tensor]]


def train_together(data: Path, base: Path, *, after: int = ENDLESS) -> Pair:
    """Two processes train in `base / "run"`."""
    seen = base / "seen"
    seen.mkdir(parents=True, exist_ok=True)
    ended = start(__name__, str(data), str(base / "run"), str(seen), str(after))
    assert ended.returncode == 0, ended.stderr
    return Pair(
        base / "run",
        [json.loads((seen / f"{rank}.json").read_text()) for rank in (0, 1)],
        [load_file(seen / f"{rank}.safetensors") for rank in (0, 1)],
    )


def read_log(folder: Path) -> list[dict[str, float]]:
    return [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_dataset(tmp_path_factory.mktemp("data") / "lid")


@pytest.fixture(scope="module")
def whole(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Pair:
    return train_together(data, tmp_path_factory.mktemp("whole"))


def test_both_processes_end_with_the_same_weights(whole: Pair):
    ours, theirs = whole.weights
    assert set(ours) == set(theirs)
    assert all(torch.equal(ours[name], theirs[name]) for name in ours)
    assert [numbers["update"] for numbers in whole.numbers] == [PRETRAINING + UPDATES] * 2


def test_one_of_them_writes_and_tells(whole: Pair):
    assert {path.name for path in whole.folder.iterdir()} == {
        "config.json",
        "log.csv",
        "log.jsonl",
        "state",
    }
    assert len(list((whole.folder / "state").iterdir())) == 2
    assert [row["update"] for row in read_log(whole.folder)] == list(
        range(1, PRETRAINING + UPDATES + 1)
    )
    assert whole.numbers[0]["told"] == 1 + PRETRAINING + UPDATES + UPDATES // 4
    assert whole.numbers[1]["told"] == 0
    assert [numbers["validated"] for numbers in whole.numbers] == [True, False]


def test_losses_are_those_of_one_process_with_the_whole_batch(
    data: Path, tmp_path: Path, whole: Pair
):
    """But for the batch norms, which see the share of a process."""
    alone, _ = train(data, tmp_path / "run", Placement(torch.device("cpu")), after=ENDLESS)
    shapes = {name: value.shape for name, value in alone.trainer.network.named_parameters()}
    assert shapes == {name: value.shape for name, value in whole.weights[0].items()}
    ours, theirs = read_log(whole.folder), read_log(tmp_path / "run")
    for name, share in (("loss", 0.01), ("nll", 0.003), ("future", 0.06)):
        got, expected = ([row[name] for row in rows if name in row] for rows in (ours, theirs))
        assert len(got) >= UPDATES
        np.testing.assert_allclose(got, expected, rtol=share)


def test_torchrun_with_the_command_line_ends_in_one_checkpoint(data: Path, tmp_path: Path):
    out = tmp_path / "run"
    budget = ("--timesteps", "72", "--batch", "4", "--window", "6", "--pretraining", "320")
    command = ("train", "--data", str(data), "--out", str(out), "--threads", "1", *budget)
    ended = start("client.main", *command, "--device", "cpu")
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.count("5 updates") == 1
    assert ended.stderr.count("held out") == 1
    checkpoint = load_checkpoint(out / "checkpoint")
    assert checkpoint.card.timesteps == 320 + 72
    # One process finds the run complete, and has the same to say.
    assert run([*command, "--device", "cpu"]) == 0
    assert load_checkpoint(out / "checkpoint").sha256 == checkpoint.sha256


def test_all_stop_where_one_is_stopped_and_go_on_to_the_same_weights(
    data: Path, tmp_path: Path, whole: Pair
):
    stopped = train_together(data, tmp_path, after=PRETRAINING + 3)
    assert [numbers["update"] for numbers in stopped.numbers] == [PRETRAINING + 3] * 2
    resumed = train_together(data, tmp_path)
    for weights in resumed.weights:
        assert all(torch.equal(weights[name], whole.weights[0][name]) for name in weights)


if __name__ == "__main__":
    main()
