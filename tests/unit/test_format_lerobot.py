"""The LeRobotDataset, read with nothing but parquet, JSON and a video decoder."""

from __future__ import annotations

import json
import os
import sys

import av
import numpy as np
import pyarrow.parquet as parquet
import pytest

from client import main as cli
from common.datasets.errors import NotExportable
from common.errors import InvalidValue, MissingExtra
from common.formats.lerobot import export_lerobot, videos, writing
from common.formats.lerobot.layout import FilePlace
from common.formats.lerobot.statistics import count_levels, describe_levels
from tests.format_data import write_recording

EYES = ("observation.images.left", "observation.images.right")


@pytest.fixture
def store(tmp_path):
    return write_recording(tmp_path / "recording", (6, 5, 9), failed=(1,))


def read_table(path):
    return parquet.read_table(path).to_pydict()


def read_info(folder):
    return json.loads((folder / "meta/info.json").read_text())


def decode(folder, info, record, key):
    """Images of an episode, found as its record says."""
    name = info["video_path"].format(
        video_key=key,
        chunk_index=record[f"videos/{key}/chunk_index"],
        file_index=record[f"videos/{key}/file_index"],
    )
    first_s, end_s = record[f"videos/{key}/from_timestamp"], record[f"videos/{key}/to_timestamp"]
    with av.open(str(folder / name)) as file:
        shown = [(float(f.pts * f.time_base), f) for f in file.decode(video=0)]
    mine = [f for time_s, f in shown if first_s - 1e-6 <= time_s < end_s - 1e-6]
    return np.stack([frame.to_ndarray(format="rgb24") for frame in mine])


def read_records(folder):
    table = read_table(folder / "meta/episodes/chunk-000/file-000.parquet")
    return [dict(zip(table, values, strict=True)) for values in zip(*table.values(), strict=True)]


@pytest.mark.parametrize("codec", ["av1", "h264"])
def test_rows_and_images_are_found_where_the_tables_say(store, tmp_path, codec):
    os.environ.setdefault("SVT_LOG", "1")
    summary = export_lerobot(store, tmp_path / "out", codec=codec)
    assert (summary.episodes, summary.rows) == (2, 15)
    assert "1 failed episodes are left out" in summary.notes
    info = read_info(tmp_path / "out")
    rows = read_table(tmp_path / "out/data/chunk-000/file-000.parquet")
    for record, episode in zip(read_records(tmp_path / "out"), (store[0], store[2]), strict=True):
        part = slice(record["dataset_from_index"], record["dataset_to_index"])
        motion = np.array(rows["action"][part], np.float32)
        assert np.array_equal(motion[:, :6], episode["intended"].astype(np.float32))
        assert np.array_equal(motion[:, 6], episode["grasp"])
        assert np.array_equal(
            np.array(rows["executed_action"][part], np.float32), episode["action"].astype("f4")
        )
        assert rows["frame_index"][part] == list(range(len(episode)))
        assert np.allclose(rows["timestamp"][part], np.arange(len(episode)) / 10)
        for eye, key in enumerate(EYES):
            images = decode(tmp_path / "out", info, record, key)
            assert images.shape == (len(episode), 128, 128, 3)
            error = images.astype(float) - episode["images"][:, eye, :, :, None]
            assert np.sqrt(np.mean(np.square(error))) < 4.0


def test_info_says_what_lerobot_asks_for(store, tmp_path):
    export_lerobot(store, tmp_path / "out", codec="h264")
    info = read_info(tmp_path / "out")
    assert (info["codebase_version"], info["fps"], info["robot_type"]) == ("v3.0", 10, "abstract")
    assert (info["total_episodes"], info["total_frames"], info["total_tasks"]) == (2, 15, 1)
    assert info["splits"] == {"train": "0:2"}
    assert info["data_path"] == "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
    features = info["features"]
    assert features["observation.images.left"]["info"]["video.codec"] == "h264"
    assert features["observation.state"]["names"][-1] == "opening_m"
    columns = parquet.read_schema(tmp_path / "out/data/chunk-000/file-000.parquet")
    for key, feature in features.items():
        if feature["dtype"] == "video":
            continue
        kind, size = columns.field(key).type, feature["shape"][0]
        expected = feature["dtype"].replace("float32", "float")
        assert (getattr(kind, "list_size", 1), str(getattr(kind, "value_type", kind))) == (
            *(size, expected),
        )


def test_the_task_is_the_index_of_its_table(store, tmp_path):
    export_lerobot(store, tmp_path / "out", codec="h264")
    table = parquet.read_table(tmp_path / "out/meta/tasks.parquet")
    assert table.to_pydict() == {"task_index": [0], "__index_level_0__": ["Closing the lid"]}
    assert json.loads(table.schema.metadata[b"pandas"])["index_columns"] == ["__index_level_0__"]


def test_statistics_are_those_of_the_numbers(store, tmp_path):
    export_lerobot(store, tmp_path / "out", codec="h264")
    statistics = json.loads((tmp_path / "out/meta/stats.json").read_text())
    good = [store[0], store[2]]
    intended = np.concatenate([episode["intended"] for episode in good])
    assert np.allclose(statistics["action"]["std"][:6], intended.std(axis=0))
    assert np.allclose(statistics["action"]["q10"][:6], np.quantile(intended, 0.1, axis=0))
    right = np.concatenate([episode["images"][:, 1] for episode in good]) / 255
    described = statistics["observation.images.right"]
    assert np.allclose(described["mean"], np.full((3, 1, 1), right.mean()))
    assert np.allclose(described["std"], np.full((3, 1, 1), right.std()))
    assert described["count"] == [15]
    record = read_records(tmp_path / "out")[1]
    assert np.allclose(record["stats/action/max"][:6], good[1]["intended"].max(axis=0))


def test_statistics_of_gray_levels():
    images = np.random.default_rng(0).integers(7, 250, (3, 16, 16)).astype(np.uint8)
    described = describe_levels(count_levels(images), images=3)
    levels = np.sort(images.reshape(-1)) / 255
    expected = {"min": levels[0], "max": levels[-1], "q50": levels[len(levels) // 2 - 1]}
    assert {name: described[name][0][0][0] for name in expected} == expected


def test_full_files_are_followed_by_others(store, tmp_path, monkeypatch):
    monkeypatch.setattr(writing, "VIDEO_FILE_MB", 0)
    monkeypatch.setattr(writing, "DATA_FILE_MB", 0)
    export_lerobot(store, tmp_path / "out", codec="h264")
    info, records = read_info(tmp_path / "out"), read_records(tmp_path / "out")
    assert [record["data/file_index"] for record in records] == [0, 1]
    assert [record[f"videos/{EYES[0]}/file_index"] for record in records] == [0, 1]
    assert [record[f"videos/{EYES[0]}/from_timestamp"] for record in records] == [0.0, 0.0]
    assert len(read_table(tmp_path / "out/data/chunk-000/file-001.parquet")["index"]) == 9
    assert decode(tmp_path / "out", info, records[1], EYES[1]).shape[0] == 9


def test_a_thousand_files_make_a_chunk():
    place = FilePlace(1003)
    assert place.name("{chunk_index:03d}/{file_index:03d}") == "001/003"


def test_a_data_set_without_what_was_meant_has_one_action(tmp_path):
    store = write_recording(tmp_path / "recording", without=("intended", "tool_pose", "opening_m"))
    export_lerobot(store, tmp_path / "out", codec="h264")
    features = read_info(tmp_path / "out")["features"]
    assert not {"executed_action", "observation.state"} & set(features)


def test_only_failures_are_no_data_set(tmp_path):
    store = write_recording(tmp_path / "recording", (4,), failed=(0,))
    with pytest.raises(NotExportable, match="no episode succeeded"):
        export_lerobot(store, tmp_path / "out")


def test_a_rate_that_is_no_whole_number_is_refused(store, tmp_path):
    store.spec = store.spec.model_copy(update={"rate_hz": 12.5})
    with pytest.raises(NotExportable, match=r"12\.5 rows per second"):
        export_lerobot(store, tmp_path / "out")
    assert not list(tmp_path.glob("out*"))


def test_a_folder_that_exists_is_left_alone(store, tmp_path):
    with pytest.raises(InvalidValue, match="not taken"):
        export_lerobot(store, store.folder)
    assert (store.folder / "dataset.json").is_file()


def test_an_encoder_that_fails_leaves_nothing(store, tmp_path, monkeypatch):
    def fail(self, images):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(videos.VideoWriter, "append", fail)
    with pytest.raises(Exception, match="No space left"):
        export_lerobot(store, tmp_path / "out")
    assert not list(tmp_path.glob("out*"))


@pytest.mark.parametrize("package", ["av", "pyarrow"])
def test_a_missing_package_is_told(store, tmp_path, monkeypatch, package):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingExtra, match="formats"):
        export_lerobot(store, tmp_path / "out")


def test_a_codec_that_is_not_there_is_told(store, tmp_path, monkeypatch):
    monkeypatch.setattr(av, "codecs_available", {"libx264"})
    with pytest.raises(InvalidValue, match=r"PyAV has here \(h264\)"):
        export_lerobot(store, tmp_path / "out")


def test_the_command_line(store, tmp_path, capsys):
    out = str(tmp_path / "out")
    command = ["data", "export", str(store.folder), "--to", "lerobot", "--out", out]
    assert cli.run([*command, "--codec", "h264"]) == 0
    written = capsys.readouterr()
    assert written.out == f"{out}: 2 episodes, 15 rows\n"
    assert "lossy" in written.err
