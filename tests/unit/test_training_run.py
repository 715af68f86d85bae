"""Runs: they learn, go on exactly where they stopped, and refuse what is not theirs."""

import json
import threading
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
import torch

from services.policy.learning.checkpoint_errors import NoSuchDevice
from services.policy.learning.normalization import ActionStatistics
from services.policy.training.config import TrainingConfig
from services.policy.training.data import DataOrigin, TrainingData, load_training_data
from services.policy.training.device import Placement, place
from services.policy.training.errors import BadRunState, OtherRun
from services.policy.training.frames import Frames
from services.policy.training.log import COLUMNS
from services.policy.training.run import Intervals, Run, RunResult
from services.policy.training.trainer import (
    PretrainingReport,
    Trainer,
    UpdateReport,
    ValidationReport,
)
from services.policy.training.windows import open_frames
from tests.training_data import CONFIG, FORESEEING, write_dataset

HERE = Placement(torch.device("cpu"))


@dataclass
class Quiet:
    """Progress that can stop the run after an update."""

    stop: threading.Event = field(default_factory=threading.Event)
    after: int = 10**9
    reports: list[UpdateReport] = field(default_factory=list[UpdateReport])
    pretraining: list[PretrainingReport] = field(default_factory=list[PretrainingReport])
    validations: list[ValidationReport] = field(default_factory=list[ValidationReport])

    def begin(self, *, update: int, updates: int, timesteps_per_update: int) -> None:
        assert timesteps_per_update == CONFIG.batch_windows * CONFIG.network.window

    def update(self, update: int, report: UpdateReport | PretrainingReport) -> None:
        if isinstance(report, UpdateReport):
            self.reports.append(report)
        else:
            self.pretraining.append(report)
        if update >= self.after:
            self.stop.set()

    def validated(self, update: int, report: ValidationReport) -> None:
        self.validations.append(report)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> TrainingData:
    return load_training_data([write_dataset(tmp_path_factory.mktemp("run") / "lid")], CONFIG)


def train(
    folder: Path,
    data: TrainingData,
    *,
    config: TrainingConfig = CONFIG,
    progress: Quiet | None = None,
) -> RunResult:
    shown = progress or Quiet()
    intervals = Intervals(log=3, validate=6)
    run = Run(folder, config, data, placement=HERE, progress=shown, intervals=intervals)
    return run.go_on(shown.stop)


def weights(result: RunResult) -> dict[str, torch.Tensor]:
    return {name: value.clone() for name, value in result.trainer.network.state_dict().items()}


def test_a_run_learns_and_spends_its_budget(tmp_path: Path, data: TrainingData):
    progress = Quiet()
    longer = CONFIG.model_copy(update={"timesteps": 60 * 24})
    result = train(tmp_path / "run", data, config=longer, progress=progress)
    assert result.done
    assert result.update == 60
    losses = [report.loss for report in progress.reports]
    assert sum(losses[-10:]) / 10 < sum(losses[:10]) / 10 - 1.0
    assert progress.reports[-1].learning_rate < 1e-5
    assert result.validation is not None
    assert result.validation.error_m > 0.0


def test_a_run_that_was_stopped_ends_in_the_same_weights(tmp_path: Path, data: TrainingData):
    whole = train(tmp_path / "whole", data)
    first = train(tmp_path / "parts", data, progress=Quiet(after=5))
    assert not first.done
    assert first.update == 5
    second = train(tmp_path / "parts", data)
    assert second.done
    ours, theirs = weights(second), weights(whole)
    assert all(torch.equal(ours[name], theirs[name]) for name in theirs)


def test_the_log_has_every_kind_of_row_once(tmp_path: Path, data: TrainingData):
    folder = tmp_path / "run"
    train(folder, data, progress=Quiet(after=4))
    train(folder, data)
    rows = [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]
    updates = [row["update"] for row in rows]
    assert updates == sorted(set(updates))
    assert updates[-1] == CONFIG.updates
    assert all(set(row) <= set(COLUMNS) for row in rows)
    assert [row["update"] for row in rows if "validation_nll" in row] == [6, 12]
    assert len((folder / "log.csv").read_text().splitlines()) == len(rows) + 1


def test_encoders_come_first_and_a_stopped_run_goes_on_there(tmp_path: Path):
    data = load_training_data([write_dataset(tmp_path / "lid")], FORESEEING)
    whole = train(tmp_path / "whole", data, config=FORESEEING)
    progress = Quiet(after=10)
    folder = tmp_path / "run"
    train(folder, data, config=FORESEEING, progress=progress)
    assert (len(progress.pretraining), len(progress.reports)) == (10, 0)
    result = train(folder, data, config=FORESEEING)
    assert result.update == 40 + FORESEEING.updates
    ours, theirs = weights(result), weights(whole)
    assert all(torch.equal(ours[name], theirs[name]) for name in theirs)
    rows = [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]
    assert rows[-1]["timesteps"] == 40 * 8 + FORESEEING.updates * 24


def test_encoders_learn_where_the_hand_will_be():
    """Dark pictures are followed by one motion, bright ones by the opposite."""
    rows = 20
    images = np.zeros((2 * rows, 2, 64, 64), np.uint8)
    images[rows:, :, :, 32:] = 255
    future = np.ones((2 * rows, 3, 6), np.float32)
    future[:rows] = -1.0
    actions = np.full((2 * rows, 6), 1e-3, np.float32)
    spans = np.array([[0, rows], [rows, rows]])
    data = TrainingData(
        frames=Frames([images[:rows], images[rows:]]),
        actions=actions,
        grasp=actions[:, 0],
        grasp_weight=actions[:, 0],
        executed=actions,
        future=future,
        spans=spans,
        validation=spans,
        origin=DataOrigin(("d",), "0" * 64, ("lid",), ("abstract",), 2, 0, 2 * rows),
    )
    trainer = Trainer(FORESEEING, ActionStatistics.of(data.training_actions()), HERE)
    frames = open_frames(data, FORESEEING, rank=0, world_size=1)
    losses = [trainer.pretrain(frames.batch(number), number).future for number in range(40)]
    assert losses[-1] < 0.5 * losses[0]


def test_curves_are_drawn(tmp_path: Path, data: TrainingData):
    progress = Quiet()
    run = Run(tmp_path, CONFIG, data, placement=HERE, progress=progress)
    run.go_on(progress.stop)
    run.draw()
    assert (tmp_path / "curves.png").read_bytes().startswith(b"\x89PNG")


def test_another_config_or_other_data_are_refused(tmp_path: Path, data: TrainingData):
    train(tmp_path / "run", data, progress=Quiet(after=1))
    other = CONFIG.model_copy(update={"seed": 1})
    with pytest.raises(OtherRun, match="seed 0, asked for is 1"):
        train(tmp_path / "run", data, config=other)
    elsewhere = load_training_data([write_dataset(tmp_path / "d", (20, 20, 20, 21))], CONFIG)
    with pytest.raises(OtherRun, match="data_sha256"):
        train(tmp_path / "run", elsewhere)


def test_a_damaged_state_is_told(tmp_path: Path, data: TrainingData):
    train(tmp_path / "run", data, progress=Quiet(after=1))
    (file,) = (tmp_path / "run" / "state").glob("*.safetensors")
    file.write_bytes(file.read_bytes()[:-1])
    with pytest.raises(BadRunState, match="missing or damaged"):
        train(tmp_path / "run", data)


def test_the_seed_decides_the_weights(tmp_path: Path, data: TrainingData):
    short = CONFIG.model_copy(update={"timesteps": 24})
    runs = [train(tmp_path / name, data, config=short) for name in ("a", "b")]
    other = train(tmp_path / "c", data, config=short.model_copy(update={"seed": 3}))
    first, second, third = (weights(result)["grasp.weight"] for result in (*runs, other))
    assert torch.equal(first, second)
    assert not torch.equal(first, third)


@pytest.mark.parametrize("device", ["cuda:99", "cuda:0", "abacus", "mps"])
def test_a_device_that_is_not_there_is_told(device: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(NoSuchDevice, match="available: cpu"):
        place(device)
