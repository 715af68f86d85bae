"""What a benchmark ran on: versions and core model, printed with every result."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

from common import __version__


def describe_machine(packages: Sequence[str]) -> str:
    """Versions, Python, core model and load, one line each."""
    versions = ", ".join(f"{name} {version(name)}" for name in packages)
    load = os.getloadavg()[0]
    return (
        f"legato {__version__}, Python {platform.python_version()}, {versions}\n"
        f"{os.cpu_count()} x {read_core_model()}, load {load:.1f} before the start"
    )


def read_core_model() -> str:
    """Name of the processor as the kernel gives it."""
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
