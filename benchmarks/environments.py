"""Environments of their own for packages that do not go with LEGATO's."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def ensure_environment(name: str, requirements: Path, *, size: str) -> Path:
    """Make the environment where it is missing or was made for other requirements.

    Args:
        name: Of its folder in the root of the repository.
        requirements: Complete list of packages, installed without dependencies.
        size: How much it takes on the disk, to be told.

    Returns:
        Its Python.

    Raises:
        SystemExit: pip could not install it.
    """
    folder = ROOT / name
    python = folder / "bin" / "python"
    wanted = requirements.read_text()
    # Written last: an installation that was broken off is done again.
    stamp = folder / "requirements.installed.txt"
    if stamp.is_file() and stamp.read_text() == wanted:
        return python
    print(f"making {name} (once; about {size}) ...", file=sys.stderr)
    pip = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    try:
        subprocess.run([sys.executable, "-m", "venv", "--clear", str(folder)], check=True)
        subprocess.run([*pip, "--no-deps", "-r", str(requirements)], check=True)
    except subprocess.CalledProcessError as error:
        raise SystemExit(f"{requirements} could not be installed into {name}") from error
    stamp.write_text(wanted)
    return python
