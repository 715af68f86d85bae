"""A robomimic file for reading: whatever is wrong with it is told as one kind of error."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from common.datasets.errors import BadForeignFile
from common.formats.labels import Bytes
from common.formats.packages import load_package

_DEMO = re.compile(r"demo_(\d+)")
_LAYOUT = "robomimic's layout: data/demo_0/actions, data/demo_0/obs/..."


@dataclass(frozen=True)
class Demo:
    """One demonstration of the file.

    Args:
        path: Of the file.
        name: Of the group, e.g. `demo_3`.
        group: As h5py gives it.
        rows: Of its actions.
    """

    path: str
    name: str
    group: Any
    rows: int

    def wrong(self, what: str, expected: str) -> BadForeignFile:
        """The error that says so."""
        return BadForeignFile(self.path, f"data/{self.name}/{what}", expected)

    def find(self, key: str) -> Any:
        """A data set of the demonstration, unread.

        Raises:
            BadForeignFile: There is none.
        """
        found = self.group.get(key)
        if found is None or not hasattr(found, "dtype"):
            there = ", ".join(sorted(list_datasets(self.group)))
            raise self.wrong(f"{key} is missing", f"one of {there}")
        return found

    def read(self, key: str) -> npt.NDArray[Any]:
        """All values of a data set.

        Raises:
            BadForeignFile: There is none, or it is damaged.
        """
        found = self.find(key)
        try:
            return np.asarray(found[()])
        except OSError as error:
            raise self.wrong(f"{key} cannot be read ({error})", "a complete file") from error

    def read_gray(self, key: str, *, height: int, width: int) -> Bytes:
        """(rows, height, width) gray images, whether stored with one channel or three equal ones.

        Raises:
            BadForeignFile: Colour, or another type, size or number of images.
        """
        found = self.find(key)
        expected = f"{self.rows} images of {height} x {width} bytes, with 1 or 3 channels"
        shape = tuple(found.shape)
        if found.dtype != np.uint8 or len(shape) != 4 or shape[3] not in (1, 3):
            raise self.wrong(f"{key} is {found.dtype} of shape {list(shape)}", expected)
        if shape[:3] != (self.rows, height, width):
            told = f"{shape[0]} images of {shape[1]} x {shape[2]}"
            raise self.wrong(f"{key} has {told}", expected)
        images = self.read(key)
        gray = images[..., 0]
        if any((images[..., channel] != gray).any() for channel in range(1, shape[3])):
            raise self.wrong(f"{key} is in colour", "gray: channels that are equal")
        return gray


@contextlib.contextmanager
def open_file(path: Path) -> Generator[Any]:
    """Open a file and see that it has robomimic's group `data`.

    Raises:
        BadForeignFile: It is not there, is no HDF5 file, or has no group `data`.
        MissingExtra: h5py is not installed.
    """
    h5py = load_package("h5py")
    if not path.is_file():
        raise BadForeignFile(str(path), "there is no such file", "an HDF5 file of robomimic")
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        told = f"is no HDF5 file, or is cut off ({error})"
        raise BadForeignFile(str(path), told, "an HDF5 file of robomimic") from error
    with file:
        if not isinstance(file.get("data"), h5py.Group):
            raise BadForeignFile(str(path), "there is no group data", _LAYOUT)
        yield file


def list_demos(path: Path, file: Any) -> list[Demo]:
    """The demonstrations by their numbers.

    Raises:
        BadForeignFile: There is none, or one that has no actions.
    """
    groups = file["data"]
    numbered = {int(found[1]): name for name in groups if (found := _DEMO.fullmatch(name))}
    if not numbered:
        raise BadForeignFile(str(path), "there is no group data/demo_0", _LAYOUT)
    return [_open_demo(path, name, groups[name]) for _, name in sorted(numbered.items())]


def list_datasets(group: Any, prefix: str = "") -> list[str]:
    """Paths of all data sets in a group and its groups."""
    found: list[str] = []
    for name, item in group.items():
        if hasattr(item, "dtype"):
            found.append(prefix + name)
        else:
            found += list_datasets(item, f"{prefix}{name}/")
    return found


def _open_demo(path: Path, name: str, group: Any) -> Demo:
    demo = Demo(str(path), name, group, 0)
    if hasattr(group, "dtype"):
        raise BadForeignFile(str(path), f"data/{name} is no group", _LAYOUT)
    actions = demo.find("actions")
    shape = tuple(actions.shape)
    if len(shape) != 2 or shape[0] == 0 or shape[1] != 7 or actions.dtype.kind not in "fiu":
        told = f"actions is {actions.dtype} of shape {list(shape)}"
        raise demo.wrong(told, "rows of 7 numbers: dx dy dz, rotation, grasp")
    rows = int(group.attrs.get("num_samples", shape[0]))
    if rows != shape[0]:
        raise demo.wrong(f"actions has {shape[0]} rows", f"num_samples = {rows}")
    return Demo(str(path), name, group, rows)
