"""The whole command line in a golden file: a change of it is a decision, seen in review."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from client.main import VERBS

GOLDEN = Path(__file__).with_name("golden_help.txt")


def legato(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "client.main", *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        env=os.environ | {"COLUMNS": "100", "NO_COLOR": "1", "PYTHONIOENCODING": "utf-8"},
    )


def render_help() -> str:
    pages = [(), ("certs",), ("data",), ("keys",), ("policy",), ("robot",), ("topic",), *VERBS]
    return "\n".join(
        f"$ legato {' '.join((*words, '--help'))}\n{legato(*words, '--help').stdout}"
        for words in pages
    )


@pytest.mark.processes
def test_help_is_as_agreed():
    """To accept a change: `python -m tests.e2e.test_cli_help`."""
    assert render_help() == GOLDEN.read_text(encoding="utf-8")


@pytest.mark.processes
def test_help_needs_no_heavy_package():
    code = (
        "import sys; from client import main; main.format_help();"
        "print([name for name in ('httpx', 'pydantic', 'numpy', 'zenoh', 'rich') "
        "if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout.strip() == "[]", done.stderr


if __name__ == "__main__":
    GOLDEN.write_text(render_help(), encoding="utf-8")
