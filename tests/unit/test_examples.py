"""The examples run, on a short recording."""

import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from common.robots import list_robots, load_robot
from common.tasks.recording import RECORDINGS_FOLDER
from examples import retarget_recorded
from examples.retarget_sheet import compute_shares, group_joints
from services.retarget.robot_model import RobotModel

Capture = pytest.CaptureFixture[str]


@pytest.fixture
def short_recording(tmp_path: Path) -> Path:
    lines = (RECORDINGS_FOLDER / "lid.csv").read_text().splitlines(keepends=True)
    path = tmp_path / "short.csv"
    # Until the hand rests at the lid.
    path.write_text("".join(lines[:42]))
    return path


def test_retargeting_a_recording_gives_a_table_and_a_sheet(
    short_recording: Path, tmp_path: Path, capsys: Capture
):
    out = tmp_path / "out"
    arguments = ["--robot", "panda", "--recording", str(short_recording), "--out", str(out)]
    assert retarget_recorded.main(arguments) == 0
    headers, _, row, path = capsys.readouterr().out.splitlines()
    assert headers.startswith("robot  joints  hand error mm: median")
    robot, joints, *errors, held_back, failures, median_us = row.split()
    assert (robot, joints, held_back, failures) == ("panda", "7", "0%", "0")
    median_mm, p95_mm, max_mm, _, _, max_mrad = map(float, errors)
    assert 0.0 <= median_mm <= p95_mm <= max_mm < 0.1
    assert 0.0 < max_mrad < 0.1
    assert float(median_us) > 0.0
    assert path == str(out / "retarget-panda.png")
    colours = np.unique(np.array(Image.open(path).convert("RGB")).reshape(-1, 3), axis=0)
    # More than the seven lines of the joints.
    assert len(colours) > 7


def test_the_mode_can_be_chosen():
    assert retarget_recorded.load_spec("panda", None).retarget.mode == "project"
    assert retarget_recorded.load_spec("panda", "scale").retarget.mode == "scale"


def test_a_robot_without_joints_is_refused(capsys: Capture):
    assert retarget_recorded.main(["--robot", "abstract"]) == 2
    assert 'no robot with joints "abstract"' in capsys.readouterr().err


def test_without_matplotlib_the_extra_is_named(monkeypatch: pytest.MonkeyPatch, capsys: Capture):
    monkeypatch.setitem(sys.modules, "examples.retarget_sheet", None)
    assert retarget_recorded.main(["--robot", "panda"]) == 2
    assert "legato[examples]" in capsys.readouterr().err


@pytest.mark.parametrize("name", [n for n in list_robots() if load_robot(n).kind == "joints"])
def test_every_joint_has_its_place_on_the_sheet(name: str):
    names = [joint.name for joint in load_robot(name).joints]
    places = [index for members in group_joints(names).values() for index in members.values()]
    assert sorted(places) == list(range(len(names)))


def test_limits_are_the_edges_of_the_panel():
    model = RobotModel(load_robot("panda"))
    q = np.array([model.lower, 0.5 * (model.lower + model.upper), model.upper])
    assert compute_shares(model, q) == pytest.approx(np.outer([0.0, 0.5, 1.0], np.ones(7)))
