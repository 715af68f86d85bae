"""`legato data export` and `legato data import`."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import sys
from collections.abc import Generator

from client.commands import DataExport, DataImport
from common.datasets import EpisodeStore
from common.errors import InvalidValue
from common.formats.lerobot import export_lerobot
from common.formats.robomimic import ImportOptions, export_robomimic, import_robomimic
from common.formats.summary import Advance, Summary, be_quiet


def write(command: DataExport) -> int:
    """Write a data set in another format."""
    if command.to == "lerobot" and command.channels is not None:
        raise InvalidValue("--channels", command.channels, "--to robomimic beside it")
    if command.to == "robomimic" and command.codec is not None:
        raise InvalidValue("--codec", command.codec, "--to lerobot beside it")
    store = EpisodeStore.open(command.folder)
    # The encoder writes about itself to standard error.
    os.environ.setdefault("SVT_LOG", "1")
    with _show_progress("exporting") as advance:
        if command.to == "lerobot":
            codec = command.codec or "av1"
            summary = export_lerobot(store, command.out, codec=codec, advance=advance)
        else:
            channels = command.channels or 3
            summary = export_robomimic(store, command.out, channels=channels, advance=advance)
    return _tell(summary)


def read(command: DataImport) -> int:
    """Make a data set of a file in another format."""
    fields = {field.name for field in dataclasses.fields(ImportOptions)}
    options = ImportOptions(**{name: getattr(command, name) for name in fields})
    with _show_progress("importing") as advance:
        summary = import_robomimic(command.file, command.out, options, advance=advance)
    return _tell(summary)


def _tell(summary: Summary) -> int:
    for note in summary.notes:
        sys.stderr.write(note + "\n")
    sys.stdout.write(f"{summary.path}: {summary.episodes} episodes, {summary.rows} rows\n")
    return 0


@contextlib.contextmanager
def _show_progress(what: str) -> Generator[Advance]:
    """A bar on a terminal, nothing elsewhere."""
    if not sys.stderr.isatty():
        yield be_quiet
        return
    # Here, so that `--help` does not pay for it.
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True)) as progress:
        task = progress.add_task(what)
        yield lambda done, total: progress.update(task, completed=done, total=total)
