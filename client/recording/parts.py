"""Finished episodes that wait for their turn: one file each, complete because it was renamed."""

from __future__ import annotations

import os
import re
import shutil
import zipfile
from pathlib import Path

import numpy as np

from common.datasets import EpisodeMetadata, EpisodeRows

_ABOUT = "episode.json"
_NAME = re.compile(r"trial-(\d{6,})\.npz")


def part_path(folder: Path, trial: int) -> Path:
    """Where the episode of a trial waits."""
    return folder / f"trial-{trial:06d}.npz"


def write_part(folder: Path, rows: EpisodeRows, metadata: EpisodeMetadata) -> None:
    """Write an episode under a name of its own, then rename it."""
    path = part_path(folder, metadata.trial)
    unfinished = path.with_suffix(f".{os.getpid()}")
    about = np.frombuffer(metadata.model_dump_json().encode(), np.uint8)
    with unfinished.open("wb") as file:
        np.savez(file, allow_pickle=False, **{_ABOUT: about}, **rows.columns)
    unfinished.replace(path)


def read_part(folder: Path, trial: int) -> tuple[EpisodeRows, EpisodeMetadata] | None:
    """Read an episode; None if there is none, or the file was damaged by a power failure.

    Each member of the file carries a check sum, so a damaged one is found.
    """
    try:
        # Opened here: NumPy leaves a file open that turns out not to be an archive.
        with part_path(folder, trial).open("rb") as file, np.load(file) as arrays:
            columns = {name: arrays[name] for name in arrays.files}
        metadata = EpisodeMetadata.model_validate_json(columns.pop(_ABOUT).tobytes())
    except (FileNotFoundError, zipfile.BadZipFile, EOFError, KeyError, ValueError):
        return None
    return EpisodeRows(columns), metadata


def list_parts(folder: Path) -> set[int]:
    """Trials whose episodes wait."""
    found = (_NAME.fullmatch(path.name) for path in folder.glob("trial-*.npz"))
    return {int(match[1]) for match in found if match is not None}


def clear_parts(folder: Path) -> None:
    """Remove the folder with all that is left in it."""
    shutil.rmtree(folder, ignore_errors=True)
