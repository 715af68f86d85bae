"""How far a training run is, on standard error: a bar on a terminal, lines elsewhere."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING, Protocol, TextIO

from client.display import Display, LineDisplay, ScreenDisplay

if TYPE_CHECKING:
    from services.policy.training.trainer import (
        PretrainingReport,
        UpdateReport,
        ValidationReport,
    )

_LINE_EVERY_S = 10.0
_LOSSES = ("nll", "grasp", "invariant", "future")


class RunProgress(Display, Protocol):
    """Shows the updates of a run."""

    def begin(self, *, update: int, updates: int, timesteps_per_update: int) -> None:
        """Show where it starts."""
        ...

    def update(self, update: int, report: UpdateReport | PretrainingReport) -> None:
        """Show an update, counted from 1."""
        ...

    def validated(self, update: int, report: ValidationReport) -> None:
        """Show the losses on held-out demonstrations."""
        ...

    def evaluated(self, update: int, told: str) -> None:
        """Show what closed-loop trials gave."""
        ...


def open_run_progress(stream: TextIO | None = None, *, leads: bool = True) -> RunProgress:
    """The bar on a terminal, lines elsewhere, and in a process that does not lead."""
    target = sys.stderr if stream is None else stream
    return BarRunProgress(target) if target.isatty() and leads else LineRunProgress(target)


class Pace:
    """Rate and time that is left.

    Args:
        update: Where the run starts.
        updates: Where it ends.
        timesteps_per_update: Frames of an update.
    """

    def __init__(self, *, update: int, updates: int, timesteps_per_update: int) -> None:
        self._first, self._updates = update, updates
        self._timesteps = timesteps_per_update
        self._started_s = time.monotonic()

    def describe(self, update: int) -> str:
        """E.g. `812 ts/s  12:31 left`."""
        elapsed_s = time.monotonic() - self._started_s
        rate = (update - self._first) / max(elapsed_s, 1e-9)
        left_s = round((self._updates - update) / max(rate, 1e-9))
        return f"{rate * self._timesteps:.0f} ts/s  {left_s // 60}:{left_s % 60:02d} left"


class LineRunProgress(LineDisplay):
    """A line every ten seconds, and one per validation."""

    def begin(self, *, update: int, updates: int, timesteps_per_update: int) -> None:
        """Tell what an earlier run has left."""
        self._updates = updates
        self._pace = Pace(update=update, updates=updates, timesteps_per_update=timesteps_per_update)
        self._shown_s = time.monotonic()
        if update:
            self.write(f"going on after update {update} of {updates}")

    def update(self, update: int, report: UpdateReport | PretrainingReport) -> None:
        """Write a line when the last one is old."""
        if time.monotonic() - self._shown_s < _LINE_EVERY_S and update < self._updates:
            return
        self._shown_s = time.monotonic()
        told = f"{describe_losses(report)}  {self._pace.describe(update)}"
        self.write(f"{update:>6}/{self._updates}  {told}")

    def validated(self, update: int, report: ValidationReport) -> None:
        """Write a line."""
        self.write(f"{update:>6}  {describe_validation(report)}")

    def evaluated(self, update: int, told: str) -> None:
        """Write a line."""
        self.write(f"{update:>6}  {told}")


class BarRunProgress(ScreenDisplay):
    """One bar with the parts of the loss, rate and the time that is left."""

    def __init__(self, stream: TextIO) -> None:
        # Here, so that commands without progress and `--help` do not pay for it.
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn

        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=20),
            TextColumn("{task.completed:.0f}/{task.total:.0f}"),
            TextColumn("{task.fields[told]}", markup=False),
            console=Console(file=stream),
        )
        super().__init__(self._bar)
        self._task = self._bar.add_task("training", told="starting", total=0)

    def begin(self, *, update: int, updates: int, timesteps_per_update: int) -> None:
        """Show where it starts."""
        self._pace = Pace(update=update, updates=updates, timesteps_per_update=timesteps_per_update)
        self._bar.update(self._task, total=updates, completed=update)

    def update(self, update: int, report: UpdateReport | PretrainingReport) -> None:
        """Move the bar."""
        told = f"{describe_losses(report)}  {self._pace.describe(update)}"
        self._bar.update(self._task, completed=update, told=told)

    def validated(self, update: int, report: ValidationReport) -> None:
        """Write a line above the bar."""
        self._tell(f"{update:>6}  {describe_validation(report)}")

    def evaluated(self, update: int, told: str) -> None:
        """Write a line above the bar."""
        self._tell(f"{update:>6}  {told}")

    def _tell(self, line: str) -> None:
        self._bar.console.print(line, markup=False, highlight=False)


def describe_losses(report: UpdateReport | PretrainingReport) -> str:
    """The parts of the loss, e.g. `nll -11.20  grasp 0.051  invariant 0.82`."""
    parts = ((name, getattr(report, name, None)) for name in _LOSSES)
    return "  ".join(f"{name} {value:.3f}" for name, value in parts if value is not None)


def describe_validation(report: ValidationReport) -> str:
    """Losses and errors on held-out demonstrations, in one line."""
    words = [
        f"held out: nll {report.nll:.3f}",
        f"error {1e3 * report.error_m:.2f} mm {1e3 * report.error_rad:.1f} mrad",
        f"grasp {100 * report.grasp_accuracy:.1f} %",
    ]
    return "  ".join(words)
