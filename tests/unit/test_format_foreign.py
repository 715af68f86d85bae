"""robomimic files that others wrote: every known trap is detected or has its option."""

from __future__ import annotations

import logging

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from common.datasets import EpisodeStore
from common.datasets.errors import BadForeignFile
from common.errors import InvalidValue, UnknownName
from common.formats.robomimic import ImportOptions, import_robomimic
from common.se3 import differential, pose_from_wire
from tests.format_data import make_foreign_demo, write_foreign

TOLD = {"task": "lid", "robot": "abstract", "rotations": "vector"}


@pytest.fixture
def take(tmp_path):
    """Import these demonstrations with the options that are always needed and these."""

    def run(*demos, **options):
        path = write_foreign(tmp_path / "theirs.hdf5", list(demos))
        summary = import_robomimic(path, tmp_path / "ours", ImportOptions(**(TOLD | options)))
        return EpisodeStore.open(summary.path), summary

    return run


def test_a_plain_file_is_imported(take):
    demos = [make_foreign_demo(8, seed=seed) for seed in range(2)]
    store, summary = take(*demos)
    assert (summary.episodes, summary.rows, summary.notes) == (2, 16, ())
    for episode, demo in zip(store, demos, strict=True):
        assert np.array_equal(episode["action"], demo["actions"][:, :6].astype(np.float64))
        assert np.array_equal(episode["grasp"], demo["actions"][:, 6])
        assert np.array_equal(episode["images"][:, 1], demo["obs/right_gray"][..., 0])
        assert np.array_equal(episode["obs_delta_positions"], demo["obs/delta_positions"])
    assert store.verify() == []
    assert (store.spec.task, store.spec.robot, store.spec.camera.name) == (
        *("lid", "abstract", "t265"),
    )


def test_demonstrations_are_in_the_order_of_their_numbers(take):
    store, _ = take(*(make_foreign_demo(3 + n, seed=n) for n in range(11)))
    assert [info.length for info in store.episodes] == [3 + n for n in range(11)]
    assert store.episodes[10].details["demo"] == "demo_10"


def test_poses_are_those_to_which_the_actions_lead(take):
    store, _ = take(make_foreign_demo(6))
    poses = [pose_from_wire(wire) for wire in store[0]["tool_pose"].tolist()]
    assert np.array_equal(poses[0], np.eye(4))
    for step, before, after in zip(store[0]["action"], poses, poses[1:], strict=False):
        assert np.allclose(np.concatenate(differential(before, after)), step, atol=1e-12)


def test_three_equal_channels_are_one_gray(take):
    demo = make_foreign_demo(4)
    gray = demo["obs/left_gray"]
    store, _ = take(demo | {"obs/left_gray": np.repeat(gray, 3, axis=-1)})
    assert np.array_equal(store[0]["images"][:, 0], gray[..., 0])


def test_colour_is_refused(take):
    demo = make_foreign_demo(4)
    colour = np.repeat(demo["obs/left_gray"], 3, axis=-1)
    colour[2, 5, 5, 1] ^= 1
    with pytest.raises(BadForeignFile, match="data/demo_0/obs/left_gray is in colour"):
        take(demo | {"obs/left_gray": colour})


def test_mirrored_images_are_turned_back(take):
    demo = make_foreign_demo(4)
    store, _ = take(demo, mirrored=True)
    for eye, name in enumerate(("left", "right")):
        assert np.array_equal(store[0]["images"][:, eye], demo[f"obs/{name}_gray"][:, :, ::-1, 0])


def test_roll_pitch_yaw_is_about_fixed_axes(take):
    demo = make_foreign_demo(6)
    store, _ = take(demo, rotations="rpy")
    # SciPy writes turns about fixed axes in lower case.
    expected = Rotation.from_euler("xyz", demo["actions"][:, 3:6].astype(np.float64)).as_rotvec()
    assert np.allclose(store[0]["action"][:, 3:], expected, atol=1e-12)
    assert not np.allclose(store[0]["action"][:, 3:], demo["actions"][:, 3:6], atol=1e-3)


def test_how_rotations_are_written_has_to_be_said(take):
    with pytest.raises(InvalidValue, match="--rotations"):
        take(make_foreign_demo(4), rotations=None)


@pytest.mark.parametrize("option", ["task", "robot"])
def test_task_and_robot_have_to_be_said(take, option):
    with pytest.raises(InvalidValue, match=f"--{option}"):
        take(make_foreign_demo(4), **{option: None})


@pytest.mark.parametrize("wrong", [{"task": "knot"}, {"robot": "atlas"}, {"camera": "webcam"}])
def test_names_that_do_not_exist(take, wrong):
    with pytest.raises(UnknownName):
        take(make_foreign_demo(4), **wrong)


def test_scaled_actions(take):
    demo = make_foreign_demo(4)
    store, _ = take(demo, metres=0.05, radians=0.5)
    stored = demo["actions"].astype(np.float64)
    assert np.array_equal(store[0]["action"][:, :3], 0.05 * stored[:, :3])
    assert np.array_equal(store[0]["action"][:, 3:], 0.5 * stored[:, 3:6])


@pytest.mark.parametrize("metres", [0.0, -1.0, float("nan"), float("inf")])
def test_a_scale_without_meaning(take, metres):
    with pytest.raises(InvalidValue, match="--metres"):
        take(make_foreign_demo(4), metres=metres)


def test_idle_frames_at_the_start_are_dropped_and_counted(take):
    demo = make_foreign_demo(10, idle=3)
    store, _ = take(demo)
    assert (len(store[0]), store[0].info.details["idle_rows_dropped"]) == (7, 3)
    assert np.array_equal(store[0]["images"][:, 0], demo["obs/left_gray"][3:, ..., 0])
    assert np.array_equal(store[0]["obs_delta_positions"], demo["obs/delta_positions"][3:])


def test_idle_frames_can_be_kept(take):
    store, _ = take(make_foreign_demo(10, idle=3), keep_idle=True)
    assert (len(store[0]), store[0].info.details["idle_rows_dropped"]) == (10, 0)


def test_a_demonstration_that_does_nothing_keeps_a_row(take):
    demo = make_foreign_demo(5)
    store, _ = take(demo | {"actions": np.zeros((5, 7), np.float32)})
    assert len(store[0]) == 1


def test_closing_the_fingers_is_not_idle(take):
    demo = make_foreign_demo(10, idle=4)
    demo["actions"][2:, 6] = 1.0
    store, _ = take(demo)
    assert store[0].info.details["idle_rows_dropped"] == 2


def test_a_last_action_of_zero_stays_and_another_is_told(take):
    demo = make_foreign_demo(6)
    moving = demo["actions"].copy()
    moving[-1, 0] = 0.01
    store, summary = take(demo, demo | {"actions": moving})
    assert not store[0]["action"][-1].any()
    assert store[1]["action"][-1, 0] == np.float32(0.01)
    assert "last action of 1 episodes" in summary.notes[0]


def test_a_time_column_of_another_length_is_left_out_and_told(take):
    demo = make_foreign_demo(6)
    store, summary = take(demo | {"obs/time": np.arange(60.0), "time": np.arange(60.0)})
    assert "obs_time" not in [column.name for column in store.spec.columns]
    assert "left out: obs/time (another number of rows than the actions)" in summary.notes
    assert "left out: time (no observation)" in summary.notes


@pytest.mark.parametrize(
    ("extra", "reason"),
    [
        ({"obs/Head": np.zeros(6)}, "its name"),
        ({"obs/depth": np.zeros((6, 4, 4))}, "float64 of shape"),
        ({"obs/word": np.array([b"a"] * 6)}, "of shape"),
        ({"obs/number": np.float64(1.0)}, "another number of rows"),
    ],
)
def test_what_cannot_be_a_column_is_told(take, extra, reason):
    _, summary = take(make_foreign_demo(6) | extra)
    assert [reason in note for note in summary.notes] == [True]


def test_what_only_some_demonstrations_have_is_told(take):
    first, second = make_foreign_demo(6), make_foreign_demo(6)
    del second["obs/delta_positions"]
    _, summary = take(first, second)
    assert summary.notes == ("left out: obs/delta_positions (not every demonstration has it)",)


def test_kinds_of_numbers_are_kept(take):
    extras = {
        "obs/a": np.arange(6, dtype=np.int32),
        "obs/b": np.arange(6) % 2 == 0,
        "obs/c": np.arange(12, dtype=np.float16).reshape(6, 2),
        "obs/d": np.arange(6, dtype=np.uint8),
    }
    store, _ = take(make_foreign_demo(6) | extras)
    kinds = {column.name: column.dtype for column in store.spec.columns}
    assert [kinds[f"obs_{name}"] for name in "abcd"] == ["i64", "u8", "f64", "u8"]
    assert np.array_equal(store[0]["obs_c"], extras["obs/c"])


def test_grasps_of_minus_one_and_one(take):
    demo = make_foreign_demo(6)
    signed = demo["actions"].copy()
    signed[:, 6] = 2.0 * signed[:, 6] - 1.0
    store, _ = take(demo | {"actions": signed})
    assert np.array_equal(store[0]["grasp"], demo["actions"][:, 6])


def test_a_grasp_in_between_is_refused(take):
    demo = make_foreign_demo(6)
    demo["actions"][1, 6] = 0.3
    with pytest.raises(BadForeignFile, match=r"grasps 0, 0\.3, 1"):
        take(demo)


def test_other_names_of_the_images(take):
    demo = make_foreign_demo(4)
    renamed = {
        key.replace("left_gray", "cam_a").replace("right_gray", "cam_b"): values
        for key, values in demo.items()
    }
    store, _ = take(renamed, left="cam_a", right="cam_b")
    assert np.array_equal(store[0]["images"][:, 0], demo["obs/left_gray"][..., 0])


def test_an_import_can_be_trained_on(take, caplog):
    from services.policy.training.data import load_training_data
    from tests.training_data import CONFIG

    store, _ = take(*(make_foreign_demo(12, seed=seed) for seed in range(4)))
    with caplog.at_level(logging.WARNING):
        data = load_training_data([store.folder], CONFIG)
    assert (data.origin.episodes, data.origin.left_out) == (4, 0)
