"""`legato train`: from a data set to a checkpoint."""

import io
import json
from pathlib import Path

import pytest

from client.main import run
from client.training.progress import LineRunProgress
from services.policy.learning.checkpoint import load_checkpoint
from services.policy.training.trainer import PretrainingReport, UpdateReport, ValidationReport
from tests.training_data import write_dataset

SHORT = ("--timesteps", "240", "--batch", "4", "--window", "6", "--pretraining", "320")


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    lengths = (20, 25, 30, 22, 21, 23, 24, 26, 20, 20)
    return write_dataset(tmp_path_factory.mktemp("train") / "lid", lengths)


def train(data: Path, out: Path, *more: str) -> int:
    return run(["train", "--data", str(data), "--out", str(out), "--threads", "1", *SHORT, *more])


def test_a_run_ends_in_a_checkpoint(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    out = tmp_path / "run"
    assert train(data, out) == 0
    checkpoint = load_checkpoint(out / "checkpoint")
    assert checkpoint.config.tasks == ("lid",)
    assert checkpoint.config.network.window == 6
    assert checkpoint.card.dataset.episodes == 10
    assert checkpoint.card.timesteps == 320 + 240
    assert set(checkpoint.card.losses) >= {"nll", "grasp", "invariant", "validation_error_m"}
    assert checkpoint.sha256[:12] in capsys.readouterr().out
    assert {"log.jsonl", "log.csv", "curves.png"} <= {path.name for path in out.iterdir()}


def test_the_same_command_again_only_writes_the_checkpoint(data: Path, tmp_path: Path):
    out = tmp_path / "run"
    assert train(data, out) == 0
    first = load_checkpoint(out / "checkpoint").sha256
    updates = read_updates(out)
    assert train(data, out) == 0
    assert load_checkpoint(out / "checkpoint").sha256 == first
    assert read_updates(out) == updates


def read_updates(out: Path) -> list[int]:
    lines = (out / "log.jsonl").read_text().splitlines()
    return [json.loads(line)["update"] for line in lines]


def test_another_method_in_the_same_folder_is_refused(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    out = tmp_path / "run"
    assert train(data, out) == 0
    assert train(data, out, "--policy", "legato-se3") == 2
    told = capsys.readouterr().err
    assert "E-OTHER-RUN" in told
    assert "holds a run with network.loss.invariant" in told


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--data", "nowhere"), "legato demo record --task lid"),
        (("--task", "lit"), "did you mean: lid"),
        (("--task", "cup"), "the demonstrations are of lid; expected cup"),
        (("--evaluate-robot", "pandas"), "did you mean: panda"),
        (("--policy", "legato-se3", "--invariant-weight", "0.1"), "no motion-invariant loss"),
        (("--timesteps", "0"), "timesteps"),
        (("--threads", "-1"), "--threads"),
        (("--device", "cuda:7"), "available: cpu"),
    ],
)
def test_wrong_use_is_told(
    data: Path,
    tmp_path: Path,
    arguments: tuple[str, ...],
    told: str,
    capsys: pytest.CaptureFixture[str],
):
    given = ("--data", str(data)) if "--data" not in arguments else ()
    code = run(["train", *given, "--out", str(tmp_path / "run"), *arguments])
    assert code == 2
    assert told in capsys.readouterr().err


def test_lines_tell_losses_pace_and_what_is_left():
    stream = io.StringIO()
    with LineRunProgress(stream) as progress:
        progress.begin(update=3, updates=5, timesteps_per_update=320)
        progress.update(4, PretrainingReport(future=0.25))
        report = UpdateReport(
            loss=1.0,
            nll=-2.5,
            grasp=0.5,
            invariant=None,
            future=0.1,
            gradient_norm=2.0,
            learning_rate=1e-3,
        )
        progress.update(5, report)
        validation = ValidationReport(
            loss=1.0,
            nll=-2.0,
            grasp=0.1,
            invariant=None,
            error_m=0.0031,
            error_rad=0.004,
            grasp_accuracy=0.95,
        )
        progress.validated(5, validation)
        progress.evaluated(5, "abstract 3/4")
    lines = stream.getvalue().splitlines()
    assert lines[0] == "going on after update 3 of 5"
    assert "nll -2.500  grasp 0.500  future 0.100" in lines[1]
    assert lines[1].endswith("0:00 left")
    assert "error 3.10 mm 4.0 mrad  grasp 95.0 %" in lines[2]
    assert lines[3].endswith("abstract 3/4")
    assert not any("invariant" in line for line in lines)
