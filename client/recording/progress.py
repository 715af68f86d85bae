"""How far a recording is, on standard error: a bar on a terminal, one line per trial elsewhere."""

from __future__ import annotations

import sys
import time
from typing import Protocol, TextIO

from client.display import Display, LineDisplay, ScreenDisplay
from client.recording.ledger import Ledger
from client.recording.report import TrialReport


class RecordingProgress(Display, Protocol):
    """Shows the trials of a recording."""

    def begin(self, ledger: Ledger) -> None:
        """Show where it starts."""
        ...

    def update(self, ledger: Ledger, report: TrialReport) -> None:
        """Show a trial that has ended."""
        ...


def open_recording_progress(stream: TextIO | None = None) -> RecordingProgress:
    """The bar on a terminal, lines elsewhere."""
    target = sys.stderr if stream is None else stream
    return BarProgress(target) if target.isatty() else LineRecordingProgress(target)


class LineRecordingProgress(LineDisplay):
    """One line per trial, in the order of the trials."""

    def begin(self, ledger: Ledger) -> None:
        """Tell what an earlier run has left."""
        if ledger.trials:
            self.write(
                f"going on after trial {ledger.trials - 1}: {ledger.successes} of "
                f"{ledger.wanted} demonstrations are there"
            )

    def update(self, ledger: Ledger, report: TrialReport) -> None:
        """Write a line."""
        self.write(f"{ledger.successes:>4}/{ledger.wanted}  {describe_report(report)}")


class BarProgress(ScreenDisplay):
    """One bar with counts, rate and the time that is left."""

    def __init__(self, stream: TextIO) -> None:
        # Here, so that commands without progress and `--help` do not pay for it.
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn

        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.completed:.0f}/{task.total:.0f}"),
            TextColumn("{task.fields[told]}", markup=False),
            console=Console(file=stream),
        )
        super().__init__(self._bar)
        self._task = self._bar.add_task("recording", told="starting", total=0)
        self._started_s = time.monotonic()
        self._before = 0

    def begin(self, ledger: Ledger) -> None:
        """Show where it starts."""
        self._started_s = time.monotonic()
        self._before = ledger.successes
        self._bar.update(self._task, total=ledger.wanted, completed=ledger.successes)

    def update(self, ledger: Ledger, report: TrialReport) -> None:
        """Move the bar; a trial that did not succeed gets a line above it."""
        elapsed_s = time.monotonic() - self._started_s
        told = describe_pace(ledger, since=self._before, elapsed_s=elapsed_s)
        self._bar.update(self._task, completed=ledger.successes, told=told)
        if report.outcome != "success":
            self._bar.console.print(describe_report(report), markup=False, highlight=False)


def describe_pace(ledger: Ledger, *, since: int, elapsed_s: float) -> str:
    """Yield, pace and time left, e.g. `yield 96 %  25.0/min  4:48 left`."""
    words = [f"yield {100 * ledger.successes / max(1, ledger.trials):.0f} %"]
    made = ledger.successes - since
    if made > 0 and elapsed_s > 0:
        left_s = round((ledger.wanted - ledger.successes) * elapsed_s / made)
        words.append(f"{60 * made / elapsed_s:.1f}/min")
        words.append(f"{left_s // 60}:{left_s % 60:02d} left")
    return "  ".join(words)


def describe_report(report: TrialReport) -> str:
    """One trial in one line."""
    words = [f"trial {report.trial}", report.outcome]
    if report.sim_time_s > 0:
        words.append(f"{report.sim_time_s:.1f} s")
    if report.outcome != "success":
        words.append(report.reason)
    return "  ".join(words)
