"""Observations beside the images: which of them become columns."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from common.datasets import ColumnSpec, Rows
from common.formats.robomimic.source import Demo, list_datasets

_KNOWN = ("actions", "dones", "rewards")
_NAME = re.compile(r"[a-z][a-z0-9_]{0,59}")
_LOW_DIMENSIONAL = 2
_DTYPES: dict[str, Literal["u8", "i64", "f32", "f64"]] = {
    "b": "u8",
    "u": "i64",
    "i": "i64",
    "f": "f64",
}


@dataclass(frozen=True)
class Extra:
    """An observation that becomes a column.

    Args:
        key: Its path in the demonstration.
        column: What it becomes.
    """

    key: str
    column: ColumnSpec

    def read(self, demo: Demo) -> Rows:
        """Its rows.

        Raises:
            BadForeignFile: It is damaged.
        """
        return demo.read(self.key).astype(self.column.numpy_dtype)


def find_extras(
    demos: Sequence[Demo], *, skip: Sequence[str]
) -> tuple[list[Extra], dict[str, str]]:
    """What can be kept, and what not.

    Args:
        demos: All of them.
        skip: Observations that are read otherwise.

    Returns:
        Columns to come, and path -> reason of what is left out.
    """
    keys = dict.fromkeys(key for demo in demos for key in list_datasets(demo.group))
    extras, left_out = list[Extra](), dict[str, str]()
    for key in keys:
        if key in _KNOWN or key in [f"obs/{name}" for name in skip]:
            continue
        reason = _find_reason(key, demos)
        if reason is None:
            extras.append(Extra(key, _make_column(key, demos[0].find(key))))
        else:
            left_out[key] = reason
    return extras, left_out


def _find_reason(key: str, demos: Sequence[Demo]) -> str | None:
    """Why it cannot be a column, or None."""
    folder, _, name = key.rpartition("/")
    if folder != "obs":
        return "no observation"
    if _NAME.fullmatch(name) is None:
        return "its name cannot be that of a column"
    found = [demo.group.get(key) for demo in demos]
    if any(each is None for each in found):
        return "not every demonstration has it"
    if any(_rows(each) != demo.rows for each, demo in zip(found, demos, strict=True)):
        return "another number of rows than the actions"
    if len({(each.dtype, tuple(each.shape[1:])) for each in found}) > 1:
        return "its form differs between demonstrations"
    if found[0].dtype.kind not in _DTYPES or len(found[0].shape) > _LOW_DIMENSIONAL:
        return f"{found[0].dtype} of shape {list(found[0].shape[1:])} per row"
    return None


def _rows(dataset: Any) -> int:
    return int(dataset.shape[0]) if dataset.shape else 0


def _make_column(key: str, dataset: Any) -> ColumnSpec:
    name = key.rpartition("/")[2]
    dtype = "f32" if dataset.dtype == np.float32 else _DTYPES[dataset.dtype.kind]
    return ColumnSpec(
        name=f"obs_{name}",
        dtype="u8" if dataset.dtype == np.uint8 else dtype,
        shape=tuple(int(size) for size in dataset.shape[1:]),
        unit="as imported",
        meaning=f"{key} of the imported file",
    )
