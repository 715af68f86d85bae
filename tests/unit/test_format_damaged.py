"""Files that are no robomimic files, or damaged ones: told, and nothing is made of them."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from common.datasets.errors import BadForeignFile
from common.formats.robomimic import ImportOptions, import_robomimic
from tests.format_data import make_foreign_demo, write_foreign

TOLD = ImportOptions(task="lid", robot="abstract", rotations="vector")


def without(demo, key):
    return {name: values for name, values in demo.items() if name != key}


DEMO = make_foreign_demo(6)


@pytest.mark.parametrize(
    ("demo", "problem"),
    [
        (without(DEMO, "obs/right_gray"), "obs/right_gray is missing"),
        (DEMO | {"obs/left_gray": DEMO["obs/left_gray"][:5]}, "5 images of 128 x 128"),
        (DEMO | {"obs/left_gray": DEMO["obs/left_gray"][:, :64, :64]}, "6 images of 64 x 64"),
        (DEMO | {"obs/left_gray": DEMO["obs/left_gray"].astype(np.float32)}, "is float32"),
        (DEMO | {"obs/left_gray": DEMO["obs/left_gray"][..., 0]}, "of shape"),
        (DEMO | {"actions": DEMO["actions"][:, :6]}, r"actions is float32 of shape \[6, 6\]"),
        (DEMO | {"actions": DEMO["actions"] * np.float32("nan")}, "not a number"),
        (DEMO | {"actions": DEMO["actions"][:0]}, "of shape"),
    ],
)
def test_a_demonstration_of_another_form_is_refused(tmp_path, demo, problem):
    path = write_foreign(tmp_path / "theirs.hdf5", [DEMO, demo])
    with pytest.raises(BadForeignFile, match=f"data/demo_1/.*{problem}"):
        import_robomimic(path, tmp_path / "ours", TOLD)
    assert not (tmp_path / "ours").exists()


def test_a_wrong_number_of_samples_is_refused(tmp_path):
    path = write_foreign(tmp_path / "theirs.hdf5", [DEMO])
    with h5py.File(path, "r+") as file:
        file["data/demo_0"].attrs["num_samples"] = 5
    with pytest.raises(BadForeignFile, match="num_samples = 5"):
        import_robomimic(path, tmp_path / "ours", TOLD)


@pytest.mark.parametrize("content", [None, b"", b"not HDF5", "cut"])
def test_what_is_no_file_of_robomimic(tmp_path, content):
    path = tmp_path / "theirs.hdf5"
    if content == "cut":
        write_foreign(path, [DEMO])
        path.write_bytes(path.read_bytes()[:5000])
    elif content is not None:
        path.write_bytes(content)
    with pytest.raises(BadForeignFile):
        import_robomimic(path, tmp_path / "ours", TOLD)


@pytest.mark.parametrize("group", ["other", "data", "data/episode_0"])
def test_an_hdf5_file_with_another_layout(tmp_path, group):
    path = tmp_path / "theirs.hdf5"
    with h5py.File(path, "w") as file:
        file.create_group(group)
    with pytest.raises(BadForeignFile, match="there is no group data"):
        import_robomimic(path, tmp_path / "ours", TOLD)


def test_a_demonstration_that_is_no_group(tmp_path):
    path = tmp_path / "theirs.hdf5"
    with h5py.File(path, "w") as file:
        file["data/demo_0"] = np.zeros(3)
    with pytest.raises(BadForeignFile, match="data/demo_0 is no group"):
        import_robomimic(path, tmp_path / "ours", TOLD)


def test_damaged_images_are_told(tmp_path):
    path = tmp_path / "theirs.hdf5"
    write_foreign(path, [without(DEMO, "obs/left_gray")])
    with h5py.File(path, "r+") as file:
        file.create_dataset(
            "data/demo_0/obs/left_gray",
            data=DEMO["obs/left_gray"],
            chunks=(1, 128, 128, 1),
            compression="gzip",
        )
        place = file["data/demo_0/obs/left_gray"].id.get_chunk_info(3).byte_offset
    content = bytearray(path.read_bytes())
    content[place : place + 40] = b"\xff" * 40
    path.write_bytes(content)
    with pytest.raises(BadForeignFile, match="left_gray cannot be read"):
        import_robomimic(path, tmp_path / "ours", TOLD)
