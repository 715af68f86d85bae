"""The episode store: what is written is there whole or not at all."""

from __future__ import annotations

import errno
import json
import logging
import os

import numpy as np
import pytest

from common.calibration import load_calibration
from common.datasets import (
    CameraSpec,
    ColumnSpec,
    DatasetSpec,
    EpisodeMetadata,
    EpisodeRows,
    EpisodeStore,
    EpisodeWriter,
    writer,
)
from common.datasets.errors import (
    BadDataset,
    BadEpisode,
    DatasetInUse,
    DatasetVersion,
    DiskFull,
    NoDataset,
    OtherDataset,
)
from common.errors import NotWritable, UnknownName

CAMERA = CameraSpec.of(load_calibration("t265"))


def make_spec(**changes) -> DatasetSpec:
    columns = (
        ColumnSpec(name="images", dtype="u8", shape=(2, 128, 128), unit="-", meaning="stereo"),
        ColumnSpec(name="action", dtype="f64", shape=(6,), unit="m, rad", meaning="step"),
        ColumnSpec(name="grasp", dtype="u8", unit="-", meaning="1 = close"),
    )
    fields = {
        "task": "lid",
        "robot": "abstract",
        "rate_hz": 10.0,
        "tick_rate_hz": 100.0,
        "reference_delay_ticks": 0,
        "camera": CAMERA,
        "action_convention": "set-point to set-point",
        "columns": columns,
        "recording": {"seed": 0},
        "software": {"legato": "0"},
    }
    return DatasetSpec.model_validate(fields | changes)


def make_rows(length: int, *, seed: int = 0) -> EpisodeRows:
    random = np.random.default_rng(seed)
    return EpisodeRows(
        {
            "images": random.integers(0, 256, (length, 2, 128, 128), dtype=np.uint8),
            "action": random.normal(size=(length, 6)),
            "grasp": random.integers(0, 2, length, dtype=np.uint8),
        }
    )


def about(trial: int, outcome: str = "success") -> EpisodeMetadata:
    return EpisodeMetadata(trial=trial, seed=trial + 7, outcome=outcome, details={"reason": "ok"})


def write(folder, *lengths: int) -> None:
    with EpisodeWriter.open(folder, make_spec()) as out:
        for trial, length in enumerate(lengths):
            out.append(make_rows(length, seed=trial), about(trial))


def test_what_is_written_is_read(tmp_path):
    write(tmp_path, 5, 3)
    store = EpisodeStore.open(tmp_path)
    assert (len(store), store.rows, store.unfinished) == (2, 8, None)
    assert store.spec == make_spec()
    for number, length in enumerate((5, 3)):
        episode, rows = store[number], make_rows(length, seed=number)
        assert len(episode) == length
        for name, values in rows.columns.items():
            assert np.array_equal(episode[name], values)
    assert store.spans().tolist() == [[0, 5], [5, 3]]
    assert store.episodes[1].seed == 8
    assert store.episodes[1].details == {"reason": "ok"}
    assert store.verify() == []


def test_slices_are_views_that_cannot_be_written(tmp_path):
    write(tmp_path, 5)
    column = EpisodeStore.open(tmp_path).column("images")
    window = column[1:4]
    assert window.base is not None
    with pytest.raises(ValueError, match="read-only"):
        window[0] = 0


def test_appending_goes_on_where_it_ended(tmp_path):
    write(tmp_path, 4)
    write(tmp_path, 2)
    assert [info.start for info in EpisodeStore.open(tmp_path).episodes] == [0, 4]


def test_an_empty_data_set_can_be_read(tmp_path):
    write(tmp_path)
    store = EpisodeStore.open(tmp_path)
    assert len(store) == 0
    assert store.column("images").shape == (0, 2, 128, 128)
    assert store.spans().shape == (0, 2)


def tear(folder, where: str) -> None:
    """Leave the files as a writer does that is killed while it appends."""
    path = folder / where
    rest = b'{"trial":9,"se' if where == "episodes.jsonl" else b"x" * 40_000
    with path.open("ab") as file:
        file.write(rest)


@pytest.mark.parametrize("where", ["images.u8", "action.f64", "episodes.jsonl"])
def test_a_torn_end_is_told_when_read_and_cut_when_written(tmp_path, caplog, where):
    write(tmp_path, 5, 3)
    sizes = {path.name: path.stat().st_size for path in tmp_path.iterdir()}
    tear(tmp_path, where)
    with caplog.at_level(logging.WARNING):
        store = EpisodeStore.open(tmp_path)
    assert len(store) == 2
    assert "belong to no complete episode" in (store.unfinished or "")
    assert len(caplog.records) == 1
    assert store.verify() == []
    with EpisodeWriter.open(tmp_path, make_spec()) as out:
        assert "cut off" in (out.repaired or "")
        assert {path.name: path.stat().st_size for path in tmp_path.iterdir()} == sizes
        out.append(make_rows(1, seed=5), about(2))
    store = EpisodeStore.open(tmp_path)
    assert (store.unfinished, store.verify(), len(store)) == (None, [], 3)


def test_a_last_line_of_zeros_is_torn(tmp_path):
    write(tmp_path, 5)
    with (tmp_path / "episodes.jsonl").open("ab") as file:
        file.write(b"\0" * 100 + b"\n")
    assert len(EpisodeStore.open(tmp_path)) == 1
    with EpisodeWriter.open(tmp_path, make_spec()):
        pass
    assert EpisodeStore.open(tmp_path).unfinished is None


def test_every_cut_of_the_files_leaves_whole_episodes(tmp_path):
    """Whatever part of the last episode reached the disk: the first one is complete."""
    write(tmp_path, 2, 2)
    images = (tmp_path / "images.u8").read_bytes()
    line_end = (tmp_path / "episodes.jsonl").read_bytes().index(b"\n") + 1
    index = (tmp_path / "episodes.jsonl").read_bytes()
    for kept_rows, kept_bytes in ((2, 0), (3, 0), (4, 0), (4, 10), (4, len(index) - line_end - 1)):
        (tmp_path / "images.u8").write_bytes(images[: kept_rows * 2 * 128 * 128])
        (tmp_path / "episodes.jsonl").write_bytes(index[: line_end + kept_bytes])
        store = EpisodeStore.open(tmp_path)
        assert (len(store), store.verify()) == (1, [])


def test_a_column_shorter_than_its_episodes_is_refused(tmp_path):
    write(tmp_path, 5)
    os.truncate(tmp_path / "action.f64", 4 * 48)
    for open_it in (EpisodeStore.open, lambda folder: EpisodeWriter.open(folder, make_spec())):
        with pytest.raises(BadDataset, match=r"action\.f64: has 4 rows, the episodes 5"):
            open_it(tmp_path)


@pytest.mark.parametrize("name", ["episodes.jsonl", "grasp.u8"])
def test_a_missing_file_is_refused(tmp_path, name):
    write(tmp_path, 5)
    (tmp_path / name).unlink()
    with pytest.raises(BadDataset, match=name):
        EpisodeStore.open(tmp_path)


def test_a_damaged_line_is_named(tmp_path):
    write(tmp_path, 2, 2, 2)
    path = tmp_path / "episodes.jsonl"
    lines = path.read_bytes().split(b"\n")
    path.write_bytes(b"\n".join([lines[0], b"{}", *lines[2:]]))
    with pytest.raises(BadDataset, match="line 2 is not an episode"):
        EpisodeStore.open(tmp_path)
    path.write_bytes(b"\n".join([lines[0], *lines[2:]]))
    with pytest.raises(BadDataset, match="line 2 starts at row 4, not 2"):
        EpisodeStore.open(tmp_path)


def test_verify_finds_the_changed_episode(tmp_path):
    write(tmp_path, 3, 3, 3)
    with (tmp_path / "grasp.u8").open("r+b") as file:
        file.seek(4)
        file.write(b"\xff")
    assert EpisodeStore.open(tmp_path).verify() == [1]


@pytest.mark.parametrize(
    ("changed", "problem"),
    [
        ({"images": np.zeros((4, 2, 64, 64), np.uint8)}, r"images: has rows of \[2, 64, 64\]"),
        ({"action": np.zeros((4, 6), np.float32)}, "action: is float32; expected f64"),
        ({"action": np.full((4, 6), np.nan)}, "action: has a value that is not a number"),
        ({"grasp": np.zeros(3, np.uint8)}, "has 4 rows; expected 3"),
        ({"speed": np.zeros(4)}, "speed: is unknown; expected one of images, action, grasp"),
        ({"grasp": None}, "grasp: is missing"),
    ],
)
def test_rows_that_do_not_fit_are_refused(tmp_path, changed, problem):
    write(tmp_path, 2)
    columns = {**make_rows(4).columns, **changed}
    rows = EpisodeRows({name: values for name, values in columns.items() if values is not None})
    with EpisodeWriter.open(tmp_path, make_spec()) as out, pytest.raises(BadEpisode, match=problem):
        out.append(rows, about(1))
    store = EpisodeStore.open(tmp_path)
    assert (len(store), store.unfinished) == (1, None)


def test_an_episode_without_rows_is_refused(tmp_path):
    with EpisodeWriter.open(tmp_path, make_spec()) as out, pytest.raises(BadEpisode, match="0 row"):
        out.append(make_rows(0), about(0))


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"task": "cup"}, "holds task lid, not cup"),
        ({"robot": "panda"}, "holds robot abstract, not panda"),
        ({"recording": {"seed": 1}}, r"holds recording\.seed 0, not 1"),
        ({"camera": CAMERA.model_copy(update={"sha256": "0" * 64})}, "holds camera t265"),
        ({"software": {"legato": "1"}}, r"holds software\.legato 0, not 1"),
        ({"columns": make_spec().columns[:2]}, "holds columns images"),
    ],
)
def test_another_origin_is_refused(tmp_path, changed, told):
    write(tmp_path, 2)
    with pytest.raises(OtherDataset, match=told):
        EpisodeWriter.open(tmp_path, make_spec(**changed))
    write(tmp_path, 1)


def test_a_camera_calibrated_anew_is_another_one():
    calibration = load_calibration("t265")
    other = calibration.model_copy(update={"center_px": (63.0, 64.0)})
    assert CameraSpec.of(other).sha256 != CAMERA.sha256 == CameraSpec.of(calibration).sha256


def test_one_writer_at_a_time(tmp_path):
    with EpisodeWriter.open(tmp_path, make_spec()), pytest.raises(DatasetInUse):
        EpisodeWriter.open(tmp_path, make_spec())
    write(tmp_path, 1)


def test_a_folder_with_other_files_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("work of years")
    with pytest.raises(NoDataset, match=r"other files \(thesis\.tex\)"):
        EpisodeWriter.open(tmp_path, make_spec())
    with pytest.raises(NoDataset, match=r"there is no dataset\.json"):
        EpisodeStore.open(tmp_path)


def test_a_creation_that_was_stopped_is_repeated(tmp_path):
    (tmp_path / "images.u8").write_bytes(b"")
    (tmp_path / "dataset.json.new").write_text("{")
    write(tmp_path, 2)
    assert len(EpisodeStore.open(tmp_path)) == 1


def test_another_version_is_refused(tmp_path):
    write(tmp_path, 2)
    path = tmp_path / "dataset.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"version": 2}))
    with pytest.raises(DatasetVersion, match=r"legato\.dataset version 2; readable: .* version 1"):
        EpisodeStore.open(tmp_path)


@pytest.mark.parametrize(("text", "told"), [("{", "not JSON"), ('{"x": 1}', "None version None")])
def test_a_damaged_description_is_refused(tmp_path, text, told):
    write(tmp_path, 2)
    (tmp_path / "dataset.json").write_text(text)
    with pytest.raises((BadDataset, DatasetVersion), match=told):
        EpisodeStore.open(tmp_path)


def test_a_description_with_a_wrong_field_is_refused(tmp_path):
    write(tmp_path, 2)
    path = tmp_path / "dataset.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"rate_hz": -1}))
    with pytest.raises(BadDataset, match="rate_hz"):
        EpisodeStore.open(tmp_path)


def test_an_unknown_column_is_named(tmp_path):
    write(tmp_path, 2)
    with pytest.raises(UnknownName, match="did you mean: action"):
        EpisodeStore.open(tmp_path)[0]["actoin"]


@pytest.mark.parametrize(
    ("number", "error"), [(errno.ENOSPC, DiskFull), (errno.EDQUOT, DiskFull), (5, NotWritable)]
)
@pytest.mark.parametrize("fails_at", [1, 2, 4])
def test_a_full_disk_is_told_and_costs_one_episode(tmp_path, monkeypatch, number, error, fails_at):
    """The disk takes half of a write, then no more: of a column, or of the index."""
    write(tmp_path, 3)
    pwrite, calls = os.pwrite, []

    def fail(file, payload, offset):
        calls.append(offset)
        if len(calls) == fails_at:
            return pwrite(file, payload[: len(payload) // 2], offset)
        if len(calls) > fails_at:
            raise OSError(number, "no more")
        return pwrite(file, payload, offset)

    with EpisodeWriter.open(tmp_path, make_spec()) as out:
        monkeypatch.setattr(writer.os, "pwrite", fail)
        with pytest.raises(error):
            out.append(make_rows(4), about(1))
        monkeypatch.setattr(writer.os, "pwrite", pwrite)
        store = EpisodeStore.open(tmp_path)
        assert (len(store), store.unfinished, store.verify()) == (1, None, [])
        out.append(make_rows(2), about(1))
    assert EpisodeStore.open(tmp_path).verify() == []


def test_disk_full_says_what_is_kept():
    text = str(DiskFull("/d", 4_000_000, 7))
    assert "no room for 4.0 MB" in text
    assert "7 episodes before are complete" in text


def test_image_columns_fit_the_camera():
    columns = (
        ColumnSpec(name="images", dtype="u8", shape=(2, 64, 64), unit="-", meaning="stereo"),
    )
    with pytest.raises(ValueError, match="column images has shape"):
        make_spec(columns=columns)
    with pytest.raises(ValueError, match="distinct names"):
        make_spec(columns=make_spec().columns * 2)
