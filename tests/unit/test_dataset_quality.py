"""Each check finds what it is for, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from client import main as cli
from common.datasets import (
    CameraSpec,
    DatasetSpec,
    EpisodeMetadata,
    EpisodeRows,
    EpisodeStore,
    EpisodeWriter,
)
from common.datasets.quality import QualityReport, check_quality
from common.datasets.replay import replay_setpoints
from common.messages import ActionStep
from common.se3 import apply_differential, pose_from_wire, pose_to_wire
from services.recorder.columns import describe_dataset
from services.retarget.reference import GripperReference

ROWS = 12
START = [0.1, -0.3, 0.8, 1.0, 0.0, 0.0, 0.0]


def make_spec(*, delay_ticks: int = 0) -> DatasetSpec:
    spec = describe_dataset(task="lid", robot="abstract", camera="t265", recording={}, software={})
    small = CameraSpec(name="t265", width=4, height=4, calibration={}, sha256="0" * 64)
    columns = [
        column.model_copy(update={"shape": (2, 4, 4)}) if column.name == "images" else column
        for column in spec.columns
    ]
    return spec.model_copy(
        update={
            "camera": small,
            "columns": tuple(columns),
            "reference_delay_ticks": delay_ticks,
        }
    )


def follow(actions: np.ndarray, *, delay_ticks: int) -> list[list[float]]:
    """References as the retargeter makes them, one tick before each frame and told late."""
    reference = GripperReference(pose_from_wire(START), lead=None)
    ticks = []
    for action in actions:
        step = ActionStep(
            translation_m=action[:3].tolist(), rotation_rad=action[3:].tolist(), grasp=False
        )
        reference.take([step])
        ticks += [pose_to_wire(reference.advance().T_world_start) for _ in range(10)]
    return [ticks[max(0, 10 * row - 1 - delay_ticks)] for row in range(len(actions))]


def make_columns(*, seed: int = 0, delay_ticks: int = 0) -> dict[str, np.ndarray]:
    """An episode without a fault."""
    random = np.random.default_rng(seed)
    actions = random.uniform(-0.02, 0.02, (ROWS, 6))
    references = follow(actions, delay_ticks=delay_ticks)
    actions[-1] = 0.0
    steps = 10 * np.arange(ROWS, dtype=np.int64)
    still = np.tile(START, (ROWS, 1))
    return {
        "images": random.integers(0, 256, (ROWS, 2, 4, 4), dtype=np.uint8),
        "action": actions,
        "intended": actions.copy(),
        "grasp": random.integers(0, 2, ROWS, dtype=np.uint8),
        "tool_pose": np.array(references),
        "reference_pose": np.array(references),
        "opening_m": np.zeros(ROWS),
        "gripped": np.zeros(ROWS, np.uint8),
        "robot_positions": still.copy(),
        "frame_step": steps,
        "state_step": steps.copy(),
        **{f"object_{name}": still.copy() for name in ("lid", "pot", "stove")},
    }


def check(folder, columns: dict[str, np.ndarray], *, delay_ticks: int = 0) -> QualityReport:
    """Check a data set whose second episode has these columns."""
    with EpisodeWriter.open(folder, make_spec(delay_ticks=delay_ticks)) as out:
        for trial, each in enumerate((make_columns(delay_ticks=delay_ticks), columns)):
            about = EpisodeMetadata(trial=trial, seed=trial, outcome="success", details={})
            out.append(EpisodeRows(each), about)
    return check_quality(EpisodeStore.open(folder))


@pytest.mark.parametrize("delay_ticks", [0, 3, 9, 14])
def test_a_data_set_without_a_fault(tmp_path, delay_ticks):
    """The replay agrees with the retargeter's own references, however late they are told."""
    columns = make_columns(seed=1, delay_ticks=delay_ticks)
    report = check(tmp_path, columns, delay_ticks=delay_ticks)
    assert report.problems == []
    assert (report.episodes, report.rows, report.failures) == (2, 2 * ROWS, 0)
    assert report.not_checked == []
    assert report.measured["replay error, m"] < 1e-12
    assert report.measured["replay error, rad"] < 1e-12
    assert report.measured["still share"] == 0.0
    by_name = {each.column: each for each in report.statistics}
    action = np.concatenate([make_columns()["action"], columns["action"]])
    assert by_name["action"].mean == pytest.approx(action.mean())
    assert by_name["action"].largest == action.max()
    images = np.concatenate([make_columns()["images"], columns["images"]])
    assert by_name["images"].mean == pytest.approx(images.mean())
    assert by_name["images"].least == images.min()


def test_an_episode_whose_actions_took_effect_late_has_no_fault(tmp_path):
    columns = make_columns(seed=1, delay_ticks=7)
    with EpisodeWriter.open(tmp_path, make_spec()) as out:
        for trial, details in enumerate(({"action_latency_s": 0.07}, {})):
            about = EpisodeMetadata(trial=trial, seed=trial, outcome="success", details=details)
            out.append(EpisodeRows(columns), about)
    report = check_quality(EpisodeStore.open(tmp_path))
    # The same rows are wrong where no latency is told of.
    assert [(each.episode, each.check) for each in report.problems] == [(1, "replay")]


def drop_a_frame(columns):
    columns["frame_step"][5:] += 10
    columns["state_step"][5:] += 10


def skew(columns):
    columns["state_step"][3] += 3


def jump(columns):
    columns["tool_pose"][6:, 0] += 0.2


def turn_round(columns):
    columns["tool_pose"][6] = [*START[:3], 0.0, 1.0, 0.0, 0.0]


def stand_still(columns):
    columns["action"][:] = 0.0
    columns["reference_pose"][:] = START


def go_on(columns):
    columns["action"][-1, 0] = 0.01


def hold_back(columns):
    """As a retargeter does whose set-point may not run further ahead of the hand."""
    columns["reference_pose"][7:, 1] += 0.003


def swap(columns):
    """Actions of another convention: the difference of measured poses, say."""
    columns["action"][:-1] = columns["action"][:-1][::-1].copy()


def scale_quaternion(columns):
    columns["object_pot"][2, 3:] *= 1.01


def half_grasp(columns):
    columns["grasp"][4] = 255


@pytest.mark.parametrize(
    ("spoil", "found", "told"),
    [
        (drop_a_frame, {"gaps", "replay"}, "1 frames dropped, first after row 4"),
        (skew, {"skew"}, "images and positions are 3 ticks apart"),
        (jump, {"jumps"}, "the tool jumps by 20"),
        (turn_round, {"jumps"}, " and 3.1"),
        (stand_still, {"stillness"}, "100% of the actions are zero"),
        (go_on, {"stillness"}, "the last action is not zero"),
        (hold_back, {"replay"}, "leave the recorded reference at row 7 and end up 3.0 mm"),
        (swap, {"replay"}, "leave the recorded reference at row 1"),
        (scale_quaternion, {"numbers"}, "object_pot has a quaternion that is not of length 1"),
        (half_grasp, {"numbers"}, "grasp has a value that is neither 0 nor 1"),
    ],
)
def test_a_fault_is_found_by_the_check_for_it(tmp_path, spoil, found, told):
    columns = make_columns(seed=1)
    spoil(columns)
    report = check(tmp_path, columns)
    assert {problem.check for problem in report.problems} == found
    assert {problem.episode for problem in report.problems} == {1}
    assert told in "".join(problem.detail for problem in report.problems)


def test_changed_bytes_and_numbers_that_are_none(tmp_path):
    check(tmp_path, make_columns(seed=1))
    size = ROWS * 8
    with (tmp_path / "opening_m.f64").open("r+b") as file:
        file.seek(size)
        file.write(np.array([np.nan]).tobytes())
    report = check_quality(EpisodeStore.open(tmp_path))
    assert [(p.episode, p.check) for p in report.problems] == [(1, "hash"), (1, "numbers")]
    assert report.problems[1].detail == "opening_m has a value that is not a number"


def test_an_empty_data_set_has_no_problem(tmp_path):
    with EpisodeWriter.open(tmp_path, make_spec()):
        pass
    report = check_quality(EpisodeStore.open(tmp_path))
    assert (report.episodes, report.problems, report.statistics) == (0, [], [])


def test_setpoints_are_composed_from_the_start(tmp_path):
    columns = make_columns(seed=1)
    check(tmp_path, columns)
    T = pose_from_wire(START)
    replayed = replay_setpoints(EpisodeStore.open(tmp_path)[1])
    assert len(replayed) == ROWS
    for action, expected in zip(columns["action"], replayed, strict=True):
        assert np.array_equal(T, expected)
        T = apply_differential(T, action[:3], action[3:])


def test_the_command_tells_and_fails(tmp_path, capsys):
    columns = make_columns(seed=1)
    skew(columns)
    check(tmp_path, columns)
    assert cli.run(["data", "check", str(tmp_path)]) == 1
    out = capsys.readouterr().out
    assert "episode 1: skew: images and positions are 3 ticks apart" in out
    assert "2 episodes (0 failed), 24 rows: 1 problems" in out


def test_a_sheet_shows_both_eyes_over_time(tmp_path, capsys):
    from PIL import Image

    check(tmp_path / "d", make_columns(seed=1))
    sheet = tmp_path / "sheet.png"
    arguments = ["data", "view", str(tmp_path / "d"), "--episode", "1", "--sheet", str(sheet)]
    assert cli.run(arguments) == 0
    assert f"sheet: {sheet}" in capsys.readouterr().err
    images = EpisodeStore.open(tmp_path / "d")[1]["images"]
    with Image.open(sheet) as picture:
        drawn = np.asarray(picture)
    assert drawn.shape == (2 * 26, 8 * 6)
    assert np.array_equal(drawn[14:18, 0:4], images[0, 0])
    assert np.array_equal(drawn[20:24, 6:10], images[1, 1])
    assert np.array_equal(drawn[26 + 14 : 26 + 18, 18:22], images[11, 0])
    assert cli.run([*arguments[:-1], str(tmp_path / "none" / "sheet.png")]) == 1
    assert "E-NOT-WRITABLE" in capsys.readouterr().err
