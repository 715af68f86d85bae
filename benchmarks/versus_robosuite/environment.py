"""robosuite's own environment: it needs another MuJoCo and another NumPy than LEGATO."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / ".venv-robosuite"
REQUIREMENTS = Path(__file__).with_name("requirements.txt")
NEWEST_PYTHON = (3, 12)


def ensure_environment() -> Path:
    """Make the environment where it is missing or was made for other requirements.

    Returns:
        Its Python.

    Raises:
        SystemExit: This Python is too new for the NumPy it needs, or pip could not install it.
    """
    python = FOLDER / "bin" / "python"
    wanted = REQUIREMENTS.read_text()
    # Written last: an installation that was broken off is done again.
    stamp = FOLDER / "requirements.installed.txt"
    if stamp.is_file() and stamp.read_text() == wanted:
        return python
    if sys.version_info[:2] > NEWEST_PYTHON:
        newest = ".".join(map(str, NEWEST_PYTHON))
        raise SystemExit(
            f"robosuite needs NumPy 1, whose last wheels are for Python {newest}: make "
            f"{FOLDER.name} with it (python{newest} -m venv --clear {FOLDER.name}, install "
            f"{REQUIREMENTS.name} with --no-deps, copy it to {stamp.name} in there)"
        )
    print(f"making {FOLDER.name} (once; about 1.2 GB) ...", file=sys.stderr)
    pip = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    try:
        subprocess.run([sys.executable, "-m", "venv", "--clear", str(FOLDER)], check=True)
        subprocess.run([*pip, "--no-deps", "-r", str(REQUIREMENTS)], check=True)
    except subprocess.CalledProcessError as error:
        raise SystemExit(f"robosuite could not be installed into {FOLDER.name}") from error
    stamp.write_text(wanted)
    return python
