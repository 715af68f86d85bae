"""How far an evaluation is, on standard error: a live display, or one line per trial."""

from __future__ import annotations

import io
import sys
from typing import TYPE_CHECKING, Protocol, TextIO

from client.display import Display, LineDisplay, ScreenDisplay
from client.record import as_factor, describe_stages, describe_success, in_mm
from common.api import Evaluation, ProgressEvent, Trial

if TYPE_CHECKING:
    from rich.table import Table

_BAR = 12


class Progress(Display, Protocol):
    """Shows the events of an evaluation."""

    def update(self, event: ProgressEvent) -> None:
        """Show an event."""
        ...


def open_progress(stream: TextIO | None = None) -> Progress:
    """The live display on a terminal, lines elsewhere."""
    target = sys.stderr if stream is None else stream
    return LiveProgress(target) if target.isatty() else LineProgress(target)


class SilentProgress(LineDisplay):
    """Shows nothing: for trials within something that shows progress of its own."""

    def __init__(self) -> None:
        super().__init__(io.StringIO())

    def update(self, event: ProgressEvent) -> None:
        """Nothing."""


class LineProgress(LineDisplay):
    """One line per finished trial."""

    def __init__(self, stream: TextIO) -> None:
        super().__init__(stream)
        self._shown: set[int] = set()
        self._waiting: list[str] = []

    def update(self, event: ProgressEvent) -> None:
        """Write a line when a trial has ended or something is missing."""
        if event.evaluation.waiting_for != self._waiting:
            self._waiting = event.evaluation.waiting_for
            if self._waiting:
                self.write(f"waiting for {', '.join(self._waiting)}")
        trial = event.trial
        if trial is None or trial.status in ("pending", "running") or trial.id in self._shown:
            return
        self._shown.add(trial.id)
        done, total = event.evaluation.trials_done, event.evaluation.trials_total
        self.write(f"{done:>4}/{total}  {describe_trial(trial)}")


class LiveProgress(ScreenDisplay):
    """A table that stays in place: one row per task, robot and policy."""

    def __init__(self, stream: TextIO) -> None:
        # Here, so that commands without progress and `--help` do not pay for it.
        from rich.console import Console
        from rich.live import Live

        self._live = Live(console=Console(file=stream), refresh_per_second=8)
        super().__init__(self._live)
        self._last_failure = ""

    def update(self, event: ProgressEvent) -> None:
        """Redraw."""
        if event.trial is not None and event.trial.status in ("failure", "aborted"):
            self._last_failure = describe_trial(event.trial)
        self._live.update(render(event.evaluation, self._last_failure))


def render(evaluation: Evaluation, last_failure: str) -> Table:
    """The live table of one moment."""
    from rich.markup import escape
    from rich.table import Table

    request = evaluation.request
    table = Table(
        box=None,
        title=f"eval {evaluation.id} · seed {request.seed} · {request.mode}",
        title_justify="left",
        pad_edge=False,
    )
    for header in ("task", "robot", "policy", "", "done", "success", "hand error mm", "real time"):
        table.add_column(header)
    for cell in evaluation.cells:
        filled = round(_BAR * cell.done / max(1, cell.trials))
        errors = f"{in_mm(cell.median_hand_error_m)} / {in_mm(cell.p95_hand_error_m)}"
        table.add_row(
            *(cell.task, cell.robot, cell.policy),
            f"[green]{'█' * filled}[/][dim]{'░' * (_BAR - filled)}[/]",
            f"{cell.done}/{cell.trials}",
            escape(describe_success(cell)),
            errors,
            as_factor(cell.real_time_factor),
        )
    notes: list[str] = []
    if evaluation.waiting_for:
        notes.append(f"waiting for {', '.join(evaluation.waiting_for)}")
    if last_failure:
        notes.append(f"last failure: {last_failure}")
    table.caption = escape("\n".join(notes)) or None
    table.caption_justify = "left"
    return table


def describe_trial(trial: Trial) -> str:
    """One finished trial in one line."""
    words = [f"{trial.task} {trial.robot} {trial.policy}", f"trial {trial.index}", trial.status]
    if trial.result is not None:
        result = trial.result
        words.append(f"{result.sim_time_s:.1f} s")
        words.append(f"hand error p95 {in_mm(result.hand_error_m.p95)} mm")
        if result.wall_time_s > 0:
            words.append(as_factor(result.sim_time_s / result.wall_time_s))
    if trial.status != "success":
        if trial.stages is not None:
            words.append(f"reached: {describe_stages(trial.stages)}")
        if trial.reason:
            words.append(trial.reason)
    return "  ".join(words)
