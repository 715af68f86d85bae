"""Files that are there whole or not at all: made under another name, renamed at the end."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Generator
from pathlib import Path

from common.errors import InvalidValue, NotWritable


@contextlib.contextmanager
def new_output(path: Path) -> Generator[Path]:
    """Give the name under which to make a file or folder; what is half made is removed.

    Args:
        path: What it is called once it is complete.

    Raises:
        InvalidValue: There is something of that name.
        NotWritable: It cannot be made there, or there is no room.
    """
    if path.exists():
        raise InvalidValue("--out", str(path), "a name that is not taken")
    made = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _remove(made)
        yield made
        made.rename(path)
    except OSError as error:
        raise NotWritable(str(path), error.strerror or str(error)) from error
    finally:
        _remove(made)


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    elif path.exists():
        path.unlink()
