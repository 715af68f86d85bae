"""`legato demo record`: demonstrations by the scripted expert."""

from __future__ import annotations

import sys
import threading
from pathlib import Path

from client.commands import DemoRecord
from client.interrupts import INTERRUPTED, postpone_interrupts
from client.recording.plan import make_plan
from client.recording.progress import open_recording_progress
from client.recording.recorder import Summary, record


def run(command: DemoRecord) -> int:
    """Record what is missing, tell what is there, and whether it was interrupted."""
    plan = make_plan(command)
    spec = plan.describe()
    stop = threading.Event()
    with postpone_interrupts(stop), open_recording_progress() as progress:
        summary = record(plan, spec, progress=progress, stop=stop)
    interrupted = stop.is_set() and summary.successes < plan.episodes
    if interrupted:
        sys.stderr.write("interrupted; run the same command again to go on\n")
    sys.stdout.write(format_summary(plan.folder, summary) + "\n")
    return INTERRUPTED if interrupted else 0


def format_summary(folder: Path, summary: Summary) -> str:
    """What is in the data set now, in one line."""
    words = [
        f"{folder}: {summary.episodes} episodes",
        f"{summary.rows} rows",
        f"{summary.size_bytes / 1e6:.1f} MB",
        f"{summary.successes} of {summary.trials} trials succeeded",
    ]
    if summary.aborted:
        words.append(f"{summary.aborted} aborted")
    return ", ".join(words) + f" ({summary.wall_time_s:.0f} s)"
