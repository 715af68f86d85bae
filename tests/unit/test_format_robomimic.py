"""Export to robomimic and back: the same data set; a file of the layout that robomimic reads."""

from __future__ import annotations

import json
import sys

import h5py
import numpy as np
import pytest

from client import main as cli
from common.datasets.errors import BadForeignFile, NotExportable
from common.errors import InvalidValue, MissingExtra, NotWritable
from common.formats.labels import list_history, spread
from common.formats.robomimic import ImportOptions, export_robomimic, import_robomimic
from common.formats.robomimic.layout import ActionCoding
from tests.format_data import write_recording


@pytest.fixture
def store(tmp_path):
    return write_recording(tmp_path / "recording")


@pytest.fixture
def exported(store, tmp_path):
    export_robomimic(store, tmp_path / "lid.hdf5")
    return tmp_path / "lid.hdf5"


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("without", [(), ("intended", "tool_pose")])
def test_export_and_import_give_the_same_files(tmp_path, channels, without):
    store = write_recording(tmp_path / "recording", (6, 9, 4), failed=(1,), without=without)
    export_robomimic(store, tmp_path / "lid.hdf5", channels=channels)
    summary = import_robomimic(tmp_path / "lid.hdf5", tmp_path / "back")
    assert (summary.episodes, summary.rows) == (3, 19)
    files = sorted(path.name for path in store.folder.iterdir())
    assert files == sorted(path.name for path in summary.path.iterdir())
    for name in files:
        assert (store.folder / name).read_bytes() == (summary.path / name).read_bytes(), name


def test_actions_are_what_was_meant_in_the_range_that_robomimic_can_say(store, exported):
    with h5py.File(exported) as file:
        data = file["data"]
        scale, offset = data.attrs["action_scale"], data.attrs["action_offset"]
        for number, episode in enumerate(store):
            actions = data[f"demo_{number}/actions"][()]
            assert actions.dtype == np.float32
            assert np.abs(actions).max() <= 1.0
            told = actions.astype(np.float64) * scale + offset
            assert np.array_equal(told[:, :6], episode["intended"].astype(np.float32))
            assert np.array_equal(told[:, 6], episode["grasp"])


def test_the_scale_is_the_least_power_of_two_that_no_value_exceeds():
    labels = np.zeros((3, 7))
    labels[1, 2], labels[2, 4] = -0.03, 0.25
    coding = ActionCoding.fit([labels[:2], labels[2:]])
    assert coding.scale.tolist() == [2**-5] * 3 + [0.25] * 3 + [0.5]
    assert coding.encode(labels)[2, 4] == 1.0


def test_labels_that_never_move_can_be_exported():
    assert ActionCoding.fit([np.zeros((2, 7))]).encode(np.zeros((2, 7)))[0].tolist() == [
        0.0
    ] * 6 + [-1.0]


def test_the_layout_is_what_robomimic_looks_for(store, exported):
    with h5py.File(exported) as file:
        data, demo = file["data"], file["data/demo_1"]
        environment = json.loads(data.attrs["env_args"])
        assert set(environment) == {"env_name", "type", "env_kwargs"}
        assert (data.attrs["total"], demo.attrs["num_samples"]) == (15, 9)
        assert demo["obs/left_gray"].shape == (9, 128, 128, 3)
        assert np.array_equal(demo["obs/right_gray"][..., 2], store[1]["images"][:, 1])
        assert demo["obs/opening_m"].shape == (9, 1)
        assert demo["dones"][()].tolist() == demo["rewards"][()].tolist() == [0] * 8 + [1]
        # Nothing that a policy must not see, nor the labels, is an observation.
        assert not {"object_lid", "action", "intended", "grasp"} & set(demo["obs"])


def test_the_observed_history_is_that_of_executed_actions(store, exported):
    with h5py.File(exported) as file:
        observed = file["data/demo_0/obs"]
        action = store[0]["action"].astype(np.float32)
        positions = observed["delta_positions"][()]
        assert not positions[0].any()
        assert positions[1].tolist() == [0.0] * 3 + action[0, :3].tolist()
        assert positions[4].tolist() == [*action[2, :3].tolist(), *action[3, :3].tolist()]
        assert observed["delta_quaternions"][0].tolist() == [1.0, 0.0, 0.0, 0.0] * 2


def test_an_episode_shorter_than_the_history():
    assert list_history(np.ones((1, 6))).tolist() == [[[0.0] * 6] * 2]


def test_masks_split_the_successful_episodes(tmp_path):
    store = write_recording(tmp_path / "recording", (3,) * 12, failed=(2, 5))
    summary = export_robomimic(store, tmp_path / "lid.hdf5")
    with h5py.File(tmp_path / "lid.hdf5") as file:
        masks = {name: [each.decode() for each in file["mask"][name]] for name in file["mask"]}
    assert masks["failed"] == ["demo_2", "demo_5"]
    assert len(masks["valid"]) == 1
    named = {name for names in masks.values() for name in names}
    assert named == {f"demo_{n}" for n in range(12)}
    assert summary.notes == ("2 failed episodes are in the file and in mask/failed",)


def test_what_is_held_out_is_spread_evenly():
    assert spread(10, 0) == []
    assert spread(100, 3) == [25, 50, 74]


@pytest.mark.parametrize(
    ("without", "problem"), [(("images",), "no column images"), (("grasp",), "no column grasp")]
)
def test_a_data_set_without_what_is_learned_is_refused(tmp_path, without, problem):
    store = write_recording(tmp_path / "recording", without=without)
    with pytest.raises(NotExportable, match=problem):
        export_robomimic(store, tmp_path / "lid.hdf5")
    assert not list(tmp_path.glob("lid*"))


def test_a_data_set_without_episodes_is_refused(tmp_path):
    with pytest.raises(NotExportable, match="no episode"):
        export_robomimic(write_recording(tmp_path / "recording", ()), tmp_path / "lid.hdf5")


def test_nothing_is_written_over(store, exported, tmp_path):
    before = exported.read_bytes()
    with pytest.raises(InvalidValue, match="not taken"):
        export_robomimic(store, exported)
    assert exported.read_bytes() == before
    (tmp_path / "back").mkdir()
    with pytest.raises(InvalidValue, match="not taken"):
        import_robomimic(exported, tmp_path / "back")


def test_an_export_that_breaks_off_leaves_nothing(store, tmp_path):
    def interrupt(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export_robomimic(store, tmp_path / "lid.hdf5", advance=interrupt)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["recording"]


def test_a_place_where_nothing_can_be_made(store, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(NotWritable):
        export_robomimic(store, tmp_path / "file" / "lid.hdf5")


def test_a_missing_package_is_told(store, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(MissingExtra, match="formats"):
        export_robomimic(store, tmp_path / "lid.hdf5")


def edit(path, key, change):
    with h5py.File(path, "r+") as file:
        values = file[key][()]
        change(values)
        file[key][...] = values


@pytest.mark.parametrize(
    ("key", "problem"),
    [
        ("data/demo_1/legato/tool_pose", "differs from the episode"),
        ("data/demo_1/actions", "are not those of the columns"),
    ],
)
def test_an_edited_export_is_not_taken_for_the_recording(exported, tmp_path, key, problem):
    edit(exported, key, lambda values: values.__setitem__((2, 3), 0.5))
    with pytest.raises(BadForeignFile, match=f"data/demo_1/.*{problem}"):
        import_robomimic(exported, tmp_path / "back")
    assert not list(tmp_path.glob("back*"))


def test_an_export_whose_description_is_damaged_is_refused(exported, tmp_path):
    with h5py.File(exported, "r+") as file:
        file["data"].attrs["legato_dataset"] = "{}"
    with pytest.raises(BadForeignFile, match="no valid DatasetSpec"):
        import_robomimic(exported, tmp_path / "back")


@pytest.mark.parametrize(
    ("options", "named"), [({"mirrored": True}, "--mirrored"), ({"task": "cup"}, "--task")]
)
def test_an_option_that_an_export_leaves_no_choice_for(exported, tmp_path, options, named):
    with pytest.raises(InvalidValue, match=named):
        import_robomimic(exported, tmp_path / "back", ImportOptions(**options))


def test_an_option_that_agrees_is_accepted(exported, tmp_path):
    options = ImportOptions(task="lid", robot="abstract")
    assert import_robomimic(exported, tmp_path / "back", options).episodes == 2


def test_the_command_line_there_and_back(store, tmp_path, capsys):
    there, back = str(tmp_path / "cli.hdf5"), str(tmp_path / "cli")
    assert cli.run(["data", "export", str(store.folder), "--to", "robomimic", "--out", there]) == 0
    assert cli.run(["data", "import", there, "--from", "robomimic", "--out", back]) == 0
    written = capsys.readouterr()
    assert written.out.splitlines() == [f"{p}: 2 episodes, 15 rows" for p in (there, back)]
    assert "bit for bit" in written.err


@pytest.mark.parametrize(
    ("to", "option"), [("lerobot", ("--channels", "1")), ("robomimic", ("--codec", "av1"))]
)
def test_an_option_of_the_other_format_is_refused(store, tmp_path, capsys, to, option):
    out = str(tmp_path / "out")
    assert cli.run(["data", "export", str(store.folder), "--to", to, "--out", out, *option]) == 2
    assert option[0] in capsys.readouterr().err
