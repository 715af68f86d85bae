"""Where the meshes of robots are."""

from __future__ import annotations

import os
from pathlib import Path

VARIABLE = "LEGATO_MENAGERIE"
"""Environment variable that names a copy of MuJoCo Menagerie, where no option does."""


def find_menagerie() -> Path | None:
    """The folder that the environment names, or none."""
    folder = os.environ.get(VARIABLE)
    return Path(folder) if folder else None
