"""`legato data view --video --meshes`: from a data set and a folder of meshes to a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from client.main import run
from common.datasets import EpisodeMetadata, EpisodeRows, EpisodeWriter
from common.robots import load_robot
from common.robots.menagerie import VARIABLE
from common.tasks import load_task
from services.recorder.columns import describe_dataset, object_column
from services.sim.world import World
from tests.menagerie import PANDA

ROWS = 2
DTYPES = {"f64": np.float64, "u8": np.uint8, "i64": np.int64}


def write_dataset(folder: Path, robot: str) -> Path:
    """One episode in which nothing moves."""
    world = World(task=load_task("lid"), robot=load_robot(robot), seed=0)
    spec = describe_dataset(task="lid", robot=robot, camera="t265", recording={}, software={})
    rows = {
        column.name: np.zeros((ROWS, *column.shape), DTYPES[column.dtype])
        for column in spec.columns
    }
    rows["robot_positions"][:] = world.servos.positions(world.data)
    rows["opening_m"][:] = 0.05
    for name, pose in world.object_poses().items():
        rows[object_column(name)][:] = pose
    with EpisodeWriter.open(folder, spec) as out:
        about = EpisodeMetadata(trial=0, seed=0, outcome="success", details={})
        out.append(EpisodeRows(rows), about)
    return folder


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_dataset(tmp_path_factory.mktemp("recorded") / "lid-panda", "panda")


@pytest.fixture(autouse=True)
def _no_folder_from_outside(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)


def view(dataset: Path, video: Path, *options: str) -> np.ndarray:
    """The first frame of a video."""
    assert run(["data", "view", str(dataset), "--video", str(video), *options]) == 0
    with Image.open(video) as picture:
        return np.asarray(picture.convert("RGB")).copy()


def test_a_video_shows_the_meshes(recorded, tmp_path, monkeypatch, capsys):
    folder = PANDA.write(tmp_path / "menagerie")
    plain = view(recorded, tmp_path / "plain.png")
    meshed = view(recorded, tmp_path / "meshed.png", "--meshes", str(folder))
    changed = np.abs(plain.astype(int) - meshed).max(axis=2) > 30
    assert 0.005 < changed.mean() < 0.3
    monkeypatch.setenv(VARIABLE, str(folder))
    assert np.array_equal(view(recorded, tmp_path / "named.png"), meshed)
    assert f"video: {tmp_path / 'named.png'}" in capsys.readouterr().err


def test_a_folder_that_does_not_exist_is_told(recorded, tmp_path, capsys):
    video = str(tmp_path / "episode.png")
    assert run(["data", "view", str(recorded), "--video", video, "--meshes", "nowhere"]) == 1
    told = capsys.readouterr().err
    assert "E-MESHES" in told
    assert "there is no folder nowhere" in told


def test_the_option_needs_a_video(recorded, capsys):
    assert run(["data", "view", str(recorded), "--meshes", "somewhere"]) == 2
    assert "--video" in capsys.readouterr().err


def test_the_environment_is_for_robots_that_have_meshes(tmp_path, monkeypatch, capsys):
    dataset = write_dataset(tmp_path / "lid-abstract", "abstract")
    monkeypatch.setenv(VARIABLE, str(tmp_path / "nowhere"))
    assert view(dataset, tmp_path / "plain.png").any()
    video = str(tmp_path / "episode.png")
    code = run(["data", "view", str(dataset), "--video", video, "--meshes", str(tmp_path)])
    assert code == 1
    assert "has no table [meshes]" in capsys.readouterr().err
