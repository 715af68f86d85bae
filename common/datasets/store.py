"""A data set for reading: columns mapped into memory, episodes as slices of them."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt
from pydantic import ValidationError

from common.datasets.errors import BadDataset, DatasetVersion, NoDataset
from common.datasets.index import INDEX_FILE, EpisodeIndex, EpisodeInfo, read_index
from common.datasets.rows import hash_rows
from common.datasets.spec import FORMAT, VERSION, ColumnSpec, DatasetSpec, Rows
from common.errors import UnknownName

SPEC_FILE = "dataset.json"

log = logging.getLogger(__name__)


class Episode:
    """One episode: `episode["action"]` is a view of its rows; nothing is read before it is used."""

    def __init__(self, store: EpisodeStore, info: EpisodeInfo) -> None:
        self._store = store
        self.info = info

    def __len__(self) -> int:
        return self.info.length

    def __getitem__(self, column: str) -> Rows:
        return self._store.column(column)[self.info.start : self.info.end]


class EpisodeStore:
    """A data set in a folder, as far as it is complete.

    Opening reads `dataset.json` and the index only. Rows after the last complete episode, of a
    recorder that runs or was stopped, are ignored and told of in `unfinished`.
    """

    def __init__(self, folder: Path, spec: DatasetSpec, index: EpisodeIndex) -> None:
        self.folder = folder
        self.spec = spec
        self.episodes: list[EpisodeInfo] = index.episodes
        self.rows = index.rows
        self.unfinished = _describe_unfinished(folder, spec, index)
        self._mapped: dict[str, Rows] = {}

    @classmethod
    def open(cls, folder: Path) -> EpisodeStore:
        """Open a data set for reading.

        Raises:
            NoDataset: There is none.
            DatasetVersion: It is of a format that this code does not read.
            BadDataset: A file is damaged, missing or too short.
        """
        spec = load_spec(folder)
        index = load_index(folder, spec)
        store = cls(folder, spec, index)
        if store.unfinished is not None:
            log.warning("%s", store.unfinished)
        return store

    def __len__(self) -> int:
        return len(self.episodes)

    def __getitem__(self, number: int) -> Episode:
        return Episode(self, self.episodes[number])

    def __iter__(self) -> Iterator[Episode]:
        return (Episode(self, info) for info in self.episodes)

    def column(self, name: str) -> Rows:
        """All rows of a column (rows, *shape), read-only and mapped: slices are views.

        Raises:
            UnknownName: There is no such column.
        """
        mapped = self._mapped.get(name)
        if mapped is None:
            mapped = self._mapped[name] = self._map(self._find(name))
        return mapped

    def spans(self) -> npt.NDArray[np.int64]:
        """(episodes, 2) first row and length of each, to draw windows from."""
        spans = [(episode.start, episode.length) for episode in self.episodes]
        return np.array(spans, dtype=np.int64).reshape(-1, 2)

    def hash_of(self, number: int) -> str:
        """SHA-256 of an episode as it is on the disk now."""
        episode = self[number]
        return hash_rows(episode[column.name] for column in self.spec.columns)

    def verify(self) -> list[int]:
        """Numbers of the episodes whose rows are not what was written."""
        return [n for n, info in enumerate(self.episodes) if self.hash_of(n) != info.sha256]

    def _find(self, name: str) -> ColumnSpec:
        for column in self.spec.columns:
            if column.name == name:
                return column
        raise UnknownName("column", name, [column.name for column in self.spec.columns])

    def _map(self, column: ColumnSpec) -> Rows:
        shape = (self.rows, *column.shape)
        if self.rows == 0:
            return np.empty(shape, column.numpy_dtype)
        path = self.folder / column.file
        # As a plain array: slicing a `memmap` costs ten times as much.
        return np.asarray(np.memmap(path, mode="r", dtype=column.numpy_dtype, shape=shape))


def load_spec(folder: Path) -> DatasetSpec:
    """Read `dataset.json`.

    Raises:
        NoDataset: There is none.
        DatasetVersion: Another format or version.
        BadDataset: It is not valid.
    """
    path = folder / SPEC_FILE
    if not path.is_file():
        raise NoDataset(str(folder), f"there is no {SPEC_FILE}")
    try:
        fields = json.loads(path.read_bytes())
    except ValueError as error:
        raise BadDataset(str(path), f"not JSON ({error})") from error
    written = (fields.get("format"), fields.get("version")) if isinstance(fields, dict) else ()
    if written != (FORMAT, VERSION):
        got = " version ".join(str(part) for part in written) or "something else"
        raise DatasetVersion(str(folder), got, [f"{FORMAT} version {VERSION}"])
    try:
        return DatasetSpec.model_validate(fields)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise BadDataset(str(path), f"{where}: {first['msg']}") from error


def load_index(folder: Path, spec: DatasetSpec) -> EpisodeIndex:
    """Read the index and see that every column has the rows it speaks of.

    Raises:
        BadDataset: A file is missing, damaged or too short.
    """
    path = folder / INDEX_FILE
    if not path.is_file():
        raise BadDataset(str(path), "is missing")
    index = read_index(path)
    for column in spec.columns:
        file = folder / column.file
        have = file.stat().st_size // column.row_bytes if file.is_file() else 0
        if not file.is_file() or have < index.rows:
            raise BadDataset(str(file), f"has {have} rows, the episodes {index.rows}")
    return index


def count_extra_bytes(folder: Path, column: ColumnSpec, rows: int) -> int:
    """Bytes of a column's file after its complete rows."""
    return (folder / column.file).stat().st_size - rows * column.row_bytes


def _describe_unfinished(folder: Path, spec: DatasetSpec, index: EpisodeIndex) -> str | None:
    """What follows the last complete episode, or None."""
    extra = max(
        -(-count_extra_bytes(folder, column, index.rows) // column.row_bytes)
        for column in spec.columns
    )
    if extra <= 0 and index.torn_bytes == 0:
        return None
    return (
        f"{folder}: {max(extra, 0)} rows and {index.torn_bytes} bytes of the index after episode "
        f"{len(index.episodes)} belong to no complete episode (a recorder is writing, or was "
        "stopped)"
    )
