"""The log of a run: one JSON object per line, the same as CSV, and a picture of the curves."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from common.errors import MissingExtra

if TYPE_CHECKING:
    from torch.utils.tensorboard.writer import SummaryWriter

JSONL, CSV, CURVES = "log.jsonl", "log.csv", "curves.png"
COLUMNS: tuple[str, ...] = (
    "update",
    "timesteps",
    "wall_s",
    "timesteps_per_s",
    "learning_rate",
    "gradient_norm",
    "loss",
    "nll",
    "grasp",
    "invariant",
    "future",
    "validation_loss",
    "validation_nll",
    "validation_grasp",
    "validation_invariant",
    "validation_error_m",
    "validation_error_rad",
    "validation_grasp_accuracy",
    "success_rate",
)


class RunLog:
    """Appends rows; what follows the update from which a run goes on is cut off.

    Args:
        folder: Of the run.
        update: First update that is to come.
        tensorboard: Whether to write events for it too.

    Raises:
        MissingExtra: TensorBoard is not installed.
    """

    def __init__(self, folder: Path, *, update: int, tensorboard: bool = False) -> None:
        self._folder = folder
        self._board = _open_board(folder, update) if tensorboard else None
        self.rows = [row for row in _read(folder / JSONL) if row["update"] <= update]
        (folder / JSONL).write_text("".join(json.dumps(row) + "\n" for row in self.rows))
        with (folder / CSV).open("w", newline="") as file:
            writer = csv.DictWriter(file, COLUMNS)
            writer.writeheader()
            writer.writerows(self.rows)

    def append(self, row: Mapping[str, float | None]) -> None:
        """Write a row; every key is one of the columns."""
        kept = {name: value for name, value in row.items() if value is not None}
        self.rows.append(kept)
        with (self._folder / JSONL).open("a") as file:
            file.write(json.dumps(kept) + "\n")
        with (self._folder / CSV).open("a", newline="") as file:
            csv.DictWriter(file, COLUMNS).writerow(kept)
        if self._board is not None:
            for name, value in kept.items():
                self._board.add_scalar(name, value, int(kept["update"]))
            self._board.flush()

    def draw(self) -> Path:
        """Draw losses and errors over timesteps."""
        # Here, because it is needed at the end only and takes a second to import.
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        figure = Figure(figsize=(12, 7), layout="constrained")
        FigureCanvasAgg(figure)
        panels = (
            ("negative log-likelihood", ("nll", "validation_nll")),
            ("grasp cross-entropy", ("grasp", "validation_grasp")),
            ("invariant loss", ("invariant", "validation_invariant")),
            ("error of the likely action [m, rad]", ("validation_error_m", "validation_error_rad")),
            ("future", ("future",)),
            ("success rate", ("success_rate",)),
        )
        for axes, (title, names) in zip(figure.subplots(2, 3).flat, panels, strict=True):
            axes.set_title(title)
            axes.set_xlabel("timesteps")
            for name in names:
                points = [(row["timesteps"], row[name]) for row in self.rows if name in row]
                if points:
                    axes.plot(*zip(*points, strict=True), label=name)
                    axes.legend()
        path = self._folder / CURVES
        figure.savefig(path, dpi=90)
        return path


def _open_board(folder: Path, update: int) -> SummaryWriter:
    """A writer of events; what it wrote of updates that come again is hidden."""
    try:
        from torch.utils.tensorboard.writer import SummaryWriter
    except ModuleNotFoundError as error:
        raise MissingExtra(error.name or "tensorboard", "tensorboard") from error
    return SummaryWriter(folder, purge_step=update)


def _read(path: Path) -> list[dict[str, float]]:
    """Complete lines of a log."""
    if not path.is_file():
        return []
    lines = path.read_text().split("\n")[:-1]
    return [json.loads(line) for line in lines]
