"""The file of a shard for appending: a trial is there whole or not at all."""

from __future__ import annotations

import errno
import fcntl
import logging
import os
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from client.sharding.errors import BadShard, ShardInUse
from client.sharding.folder import check_alike, read_headers
from client.sharding.header import ShardHeader
from client.sharding.record import ShardRecord, TrialLine, read_shard
from common.api import Trial
from common.errors import NotWritable
from services.control.events import TrialSpec

_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)

log = logging.getLogger(__name__)


class ShardWriter:
    """Appends trials to a shard's file.

    Args:
        record: What the file holds when it is opened.
        file: The open file.
        missing: Numbers of the trials that it does not hold yet.
    """

    def __init__(self, record: ShardRecord, file: int, missing: set[int]) -> None:
        self.path = record.path
        self.missing = missing
        self._evaluation = record.header.evaluation
        self._file = file

    def append(self, trial: Trial, pictures: Mapping[str, bytes]) -> None:
        """Write a trial that has ended; when this returns, it is on the disk.

        Raises:
            NotWritable: The disk is full, or has another fault; what was complete stays.
        """
        changes = {"evaluation": self._evaluation, "pictures": list(pictures)}
        line = TrialLine(trial=trial.model_copy(update=changes), pictures=dict(pictures))
        with _told(self.path):
            _write_line(self._file, line.model_dump_json())
        self.missing.remove(trial.id)


@contextmanager
def open_shard(
    folder: Path, header: ShardHeader, grid: Sequence[TrialSpec]
) -> Generator[ShardWriter, None, None]:
    """Open a shard's file for appending; folder and file are made if they are not there.

    Args:
        folder: Of the evaluation.
        header: Which shard of which evaluation.
        grid: All trials of the evaluation.

    Raises:
        BadShard: The file, or the first line of another one in the folder, is damaged.
        NotWritable: The folder cannot be written.
        ShardInUse: Another process writes to the file.
        ShardsDiffer: The folder holds shards of something else.
    """
    path = folder / header.shard.file_name
    with _told(path):
        folder.mkdir(parents=True, exist_ok=True)
        file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    try:
        _lock(file, path)
        # Now, and not when all have run for hours: what cannot be merged is not worth running.
        check_alike(read_headers(folder), "this command", header)
        record = _resume(path, file, header)
        record.check_trials(grid)
        done = {trial.id for trial in record.trials}
        yield ShardWriter(record, file, {*header.shard.trials(len(grid))} - done)
    finally:
        os.close(file)


def _resume(path: Path, file: int, header: ShardHeader) -> ShardRecord:
    """Read what there is, cut off a torn end; begin the file if there is nothing."""
    record = read_shard(path)
    if record is None:
        line = header.model_dump_json()
        with _told(path):
            os.truncate(file, 0)
            _write_line(file, line)
        return ShardRecord(path, header, [], {}, len(line) + 1)
    if record.header.shard != header.shard:
        raise BadShard(str(path), f"holds shard {record.header.shard}")
    with _told(path):
        os.truncate(file, record.size_bytes)
    return record


def _lock(file: int, path: Path) -> None:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise ShardInUse(str(path)) from error
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            raise NotWritable(str(path), error.strerror or str(error)) from error
        # Some cluster file systems are mounted so. Two writers would show in the merge.
        log.warning("%s: the file system has no locks; run each shard once at a time", path)


def _write_line(file: int, text: str) -> None:
    """Write all of a line; the kernel may take less at a time."""
    left = memoryview(text.encode() + b"\n")
    while left:
        left = left[os.write(file, left) :]
    os.fsync(file)


@contextmanager
def _told(path: Path) -> Generator[None, None, None]:
    """Tell faults of the disk in our own words."""
    try:
        yield
    except OSError as error:
        raise NotWritable(str(path), error.strerror or str(error)) from error
