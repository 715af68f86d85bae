"""The parquet files: rows, episodes, tasks."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from common.formats.labels import Floats
from common.formats.lerobot.layout import TASKS_FILE
from common.formats.packages import load_package

# The name by which pandas, with which lerobot reads it, knows the index of a table.
_INDEX = "__index_level_0__"


def make_rows(vectors: dict[str, Floats], *, episode: int, first_row: int, fps: int) -> Any:
    """The table of an episode's rows.

    Args:
        vectors: Feature -> (n, k) numbers.
        episode: Its number.
        first_row: Of all rows, that of its first.
        fps: Rows per second.
    """
    pa = load_package("pyarrow")
    rows = len(next(iter(vectors.values())))
    columns: dict[str, Any] = {}
    for key, values in vectors.items():
        flat = pa.array(values.astype(np.float32).reshape(-1))
        columns[key] = pa.FixedSizeListArray.from_arrays(flat, values.shape[1])
    numbers = np.arange(rows, dtype=np.int64)
    columns["timestamp"] = pa.array((numbers / fps).astype(np.float32))
    columns["frame_index"] = pa.array(numbers)
    columns["episode_index"] = pa.array(np.full(rows, episode, np.int64))
    columns["index"] = pa.array(first_row + numbers)
    columns["task_index"] = pa.array(np.zeros(rows, np.int64))
    return pa.table(columns)


def describe_indices() -> dict[str, dict[str, Any]]:
    """The entries of `info.json` for what every data set has."""
    whole = ("frame_index", "episode_index", "index", "task_index")
    kinds = {"timestamp": "float32", **dict.fromkeys(whole, "int64")}
    return {key: {"dtype": kind, "shape": [1], "names": None} for key, kind in kinds.items()}


def write_table(path: Path, tables: Sequence[Any]) -> None:
    """Write tables of one form, one after the other, into a file."""
    pa, parquet = load_package("pyarrow"), load_package("pyarrow.parquet")
    path.parent.mkdir(parents=True, exist_ok=True)
    parquet.write_table(pa.concat_tables(tables), path)


def write_records(path: Path, records: Sequence[dict[str, Any]]) -> None:
    """Write records with equal keys into a file."""
    write_table(path, [load_package("pyarrow").Table.from_pylist(list(records))])


def write_tasks(root: Path, tasks: Sequence[str]) -> None:
    """Write the tasks' sentences: the index of a table of their numbers."""
    pa = load_package("pyarrow")
    table = pa.table({"task_index": list(range(len(tasks))), _INDEX: list(tasks)})
    columns = [
        {"name": "task_index", "field_name": "task_index", "pandas_type": "int64"},
        {"name": None, "field_name": _INDEX, "pandas_type": "unicode"},
    ]
    kinds = ("int64", "object")
    described = {
        "index_columns": [_INDEX],
        "column_indexes": [],
        "columns": [
            {**column, "numpy_type": kind, "metadata": None}
            for column, kind in zip(columns, kinds, strict=True)
        ],
        "pandas_version": "2.2.0",
    }
    table = table.replace_schema_metadata({"pandas": json.dumps(described)})
    write_table(root / TASKS_FILE, [table])
