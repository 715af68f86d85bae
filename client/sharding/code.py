"""The identity of the code that runs trials."""

from __future__ import annotations

import hashlib
from pathlib import Path

import common
import services

_SUFFIXES = (".py", ".xml", ".toml", ".csv")
"""Sources, robots, calibrations and recorded paths; not what Python and Numba leave beside them."""


def hash_code() -> str:
    """SHA-256 over the files of `common` and `services`: names, lengths and contents.

    It is the same for a checkout and for an installed package of one state of the code, and sees
    a change that no version number tells of.
    """
    digest = hashlib.sha256()
    for package in (common, services):
        root = Path(package.__path__[0])
        files = {path.relative_to(root).as_posix(): path for path in root.rglob("*")}
        for name in sorted(files):
            if name.endswith(_SUFFIXES):
                content = files[name].read_bytes()
                digest.update(f"{package.__name__}/{name} {len(content)}\n".encode())
                digest.update(content)
    return digest.hexdigest()
