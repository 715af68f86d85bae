"""A data set for appending: an episode is there whole or not at all."""

from __future__ import annotations

import errno
import fcntl
import logging
import os
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import Self

from common.datasets.errors import BadDataset, DatasetInUse, DiskFull, NoDataset, OtherDataset
from common.datasets.index import INDEX_FILE, EpisodeInfo, EpisodeMetadata, encode_line
from common.datasets.rows import EpisodeRows, hash_rows
from common.datasets.spec import DatasetSpec, Rows
from common.datasets.store import SPEC_FILE, count_extra_bytes, load_index, load_spec
from common.errors import NotWritable

LOCK_FILE = "writer.lock"
_NEW_SPEC_FILE = SPEC_FILE + ".new"
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT)

log = logging.getLogger(__name__)


class EpisodeWriter:
    """Appends episodes to a data set; the only one to do so. A context manager.

    Order of writing: rows of every column, sync, line of the index, sync. Whoever is stopped in
    between loses that episode only, and its rest is cut off when the data set is opened again.
    """

    def __init__(self, folder: Path, spec: DatasetSpec, lock: int) -> None:
        self.folder = folder
        self.spec = spec
        self._lock = lock
        index = load_index(folder, spec)
        self.episodes: list[EpisodeInfo] = index.episodes
        self._index_bytes = index.size_bytes
        self.repaired = self._cut_off(index.torn_bytes)
        self._columns = [_open(folder / column.file) for column in spec.columns]
        self._index = _open(folder / INDEX_FILE)

    @classmethod
    def open(cls, folder: Path, spec: DatasetSpec) -> Self:
        """Open a data set for appending; a folder that is new or empty becomes one.

        Raises:
            DatasetInUse: Another process appends to it.
            OtherDataset: It was made of something else.
            NoDataset: The folder has other files.
            DatasetVersion: Another format or version.
            BadDataset: A file is damaged.
            NotWritable: The folder cannot be written.
        """
        try:
            folder.mkdir(parents=True, exist_ok=True)
            _refuse_other_files(folder, spec)
            lock = _lock(folder)
        except OSError as error:
            raise NotWritable(str(folder), error.strerror or str(error)) from error
        try:
            if not (folder / SPEC_FILE).exists():
                _create(folder, spec)
            difference = load_spec(folder).first_difference(spec)
            if difference is not None:
                raise OtherDataset(str(folder), *difference)
            return cls(folder, spec, lock)
        except BaseException:
            os.close(lock)
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    @property
    def rows(self) -> int:
        """Rows of all complete episodes."""
        return self.episodes[-1].end if self.episodes else 0

    def append(self, rows: EpisodeRows, metadata: EpisodeMetadata) -> EpisodeInfo:
        """Write an episode and return its line of the index.

        Raises:
            BadEpisode: It does not fit the columns; nothing was written.
            DiskFull: There is no room; what was complete stays.
            NotWritable: Another fault of the disk; what was complete stays.
        """
        columns = rows.checked(self.spec)
        info = EpisodeInfo(
            **metadata.model_dump(), start=self.rows, length=len(rows), sha256=hash_rows(columns)
        )
        line = encode_line(info)
        try:
            self._write_columns(columns)
            _write(self._index, line, self._index_bytes)
            os.fsync(self._index)
        except OSError as error:
            self._cut_off(len(line))
            if error.errno in _NO_ROOM:
                needed = len(line) + len(rows) * self.spec.row_bytes
                raise DiskFull(str(self.folder), needed, len(self.episodes)) from error
            raise NotWritable(str(self.folder), error.strerror or str(error)) from error
        self._index_bytes += len(line)
        self.episodes.append(info)
        return info

    def close(self) -> None:
        """Close the files and let others write."""
        for file in (*self._columns, self._index, self._lock):
            os.close(file)

    def _write_columns(self, columns: Iterable[Rows]) -> None:
        for file, spec, values in zip(self._columns, self.spec.columns, columns, strict=True):
            _write(file, values.data.cast("B"), self.rows * spec.row_bytes)
        for file in self._columns:
            os.fsync(file)

    def _cut_off(self, torn_bytes: int) -> str | None:
        """Cut every file after the last complete episode; tell what was cut, if anything."""
        cut_rows = 0
        for column in self.spec.columns:
            extra = count_extra_bytes(self.folder, column, self.rows)
            if extra > 0:
                os.truncate(self.folder / column.file, self.rows * column.row_bytes)
                cut_rows = max(cut_rows, -(-extra // column.row_bytes))
        if torn_bytes > 0:
            os.truncate(self.folder / INDEX_FILE, self._index_bytes)
        if cut_rows == 0 and torn_bytes == 0:
            return None
        told = (
            f"{self.folder}: cut off {cut_rows} rows after episode {len(self.episodes)} that "
            "belonged to no complete episode"
        )
        log.warning("%s", told)
        return told


def _create(folder: Path, spec: DatasetSpec) -> None:
    """Make an empty data set; `dataset.json` comes last, so that it is never half a one."""
    for name in (*(column.file for column in spec.columns), INDEX_FILE):
        (folder / name).write_bytes(b"")
    new = folder / _NEW_SPEC_FILE
    with new.open("wb") as file:
        file.write(spec.model_dump_json(indent=2).encode() + b"\n")
        file.flush()
        os.fsync(file.fileno())
    new.replace(folder / SPEC_FILE)
    directory = os.open(folder, os.O_RDONLY)
    os.fsync(directory)
    os.close(directory)


def _refuse_other_files(folder: Path, spec: DatasetSpec) -> None:
    if (folder / SPEC_FILE).exists():
        return
    known = {LOCK_FILE, INDEX_FILE, _NEW_SPEC_FILE, *(column.file for column in spec.columns)}
    others = sorted(
        path.name
        for path in folder.iterdir()
        if path.name not in known or (path.stat().st_size and path.name != _NEW_SPEC_FILE)
    )
    if others:
        raise NoDataset(str(folder), f"has other files ({', '.join(others[:3])})")


def _lock(folder: Path) -> int:
    lock = os.open(folder / LOCK_FILE, os.O_WRONLY | os.O_CREAT, 0o644)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(lock)
        raise DatasetInUse(str(folder)) from error
    return lock


def _open(path: Path) -> int:
    try:
        return os.open(path, os.O_WRONLY)
    except FileNotFoundError as error:
        raise BadDataset(str(path), "is missing") from error


def _write(file: int, payload: bytes | memoryview, offset: int) -> None:
    """Write all of it; the kernel may take less at a time."""
    left = memoryview(payload)
    while left:
        written = os.pwrite(file, left, offset)
        left, offset = left[written:], offset + written
