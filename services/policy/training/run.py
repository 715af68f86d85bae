"""A training run in a folder: from its config to its checkpoint, and on from where it stopped.

RUN/config.json      the config; another one is refused
RUN/log.jsonl .csv   losses, rates; curves.png is drawn from them
RUN/state/           to go on exactly where it was
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol, cast

import torch

from common.errors import NotWritable
from services.policy.learning.normalization import ActionStatistics
from services.policy.training.config import TrainingConfig
from services.policy.training.data import TrainingData
from services.policy.training.device import Placement
from services.policy.training.errors import BadRunState, OtherRun
from services.policy.training.log import RunLog
from services.policy.training.state import RunState, load_state, save_state
from services.policy.training.trainer import (
    PretrainingReport,
    Trainer,
    UpdateReport,
    ValidationReport,
)
from services.policy.training.windows import WindowLoader, open_frames

CONFIG, STATE, DATA = "config.json", "state", "data_sha256"
_SAVE_S = 120.0
"""What is lost at most when the machine fails."""


class TrainingProgress(Protocol):
    """Is told how far a run is."""

    def begin(self, *, update: int, updates: int, timesteps_per_update: int) -> None:
        """Show where it starts."""
        ...

    def update(self, update: int, report: UpdateReport | PretrainingReport) -> None:
        """Show an update, counted from 1."""
        ...

    def validated(self, update: int, report: ValidationReport) -> None:
        """Show losses on held-out windows."""
        ...


@dataclass(frozen=True)
class Intervals:
    """How often something is done, in updates."""

    log: int = 20
    validate: int = 500


@dataclass(frozen=True)
class RunResult:
    """Where a run stands when it ends or is stopped."""

    trainer: Trainer
    update: int
    done: bool
    trained_s: float
    last: UpdateReport | None
    validation: ValidationReport | None


class Run:
    """One run.

    Args:
        folder: Where it is kept.
        config: What it depends on.
        data: What is loaded.
        placement: Device and rank.
        progress: Is told how far it is, in the process that leads.
        intervals: How often it logs and validates.
        evaluate: Success rate of the network as it is, in closed loop; asked at each validation.
        tensorboard: Whether to log for TensorBoard too.

    Raises:
        InvalidValue: The processes cannot share the batches equally.
        MissingExtra: TensorBoard is not installed.
        OtherRun: The folder holds a run with another config or other data.
        BadRunState: The state in the folder is damaged.
        NotWritable: The folder cannot be written.
    """

    def __init__(
        self,
        folder: Path,
        config: TrainingConfig,
        data: TrainingData,
        *,
        placement: Placement,
        progress: TrainingProgress,
        intervals: Intervals = Intervals(),
        evaluate: Callable[[Trainer, int], float] | None = None,
        tensorboard: bool = False,
    ) -> None:
        self._evaluate = evaluate
        self._folder, self._config = folder, config
        self._placement, self._progress, self._intervals = placement, progress, intervals
        self.statistics = ActionStatistics.of(data.training_actions())
        rank, world_size = placement.rank, placement.world_size
        # As many as the network computes with, which waits while windows are gathered.
        threads = torch.get_num_threads()
        self._loader = WindowLoader(data, config, rank=rank, world_size=world_size, threads=threads)
        self._first = 0 if config.pretraining is None else config.pretraining.updates
        self._frames = open_frames(data, config, rank=rank, world_size=world_size, threads=threads)
        if placement.leads:
            _claim(folder, config, data.origin.sha256)
        self._trainer = Trainer(config, self.statistics, placement)
        self._timesteps_per_update = config.batch_windows * config.network.window
        self._state = self._load()
        self._log = (
            RunLog(folder, update=self._state.update, tensorboard=tensorboard)
            if placement.leads
            else None
        )
        self._holds_out = len(data.validation) > 0

    def go_on(self, stop: threading.Event) -> RunResult:
        """Train until the budget is spent or it is stopped; the state is saved either way."""
        update, updates = self._state.update, self._first + self._config.updates
        if self._placement.leads:
            self._progress.begin(
                update=update, updates=updates, timesteps_per_update=self._timesteps_per_update
            )
        clock = _Clock(self._state.trained_s)
        report: UpdateReport | None = None
        validation: ValidationReport | None = None
        while update < updates and not self._placement.agree(stop.is_set()):
            made = report = None
            if update < self._first:
                made = self._trainer.pretrain(self._frames.batch(update), update)
            else:
                number = update - self._first
                made = report = self._trainer.update(self._loader.batch(number), number)
            update += 1
            if self._placement.leads:
                self._progress.update(update, made)
            validation = self._validate(update) if report is not None else None
            if update % self._intervals.log == 0 or update == updates or validation is not None:
                self._write(update, made, validation, clock)
            if clock.save_is_due():
                self._save(update, clock.trained_s)
        self._save(update, clock.trained_s)
        done = update >= updates
        if done and validation is None and self._holds_out and self._placement.leads:
            validation = self._trainer.validate(self._loader)
        return RunResult(self._trainer, update, done, clock.trained_s, report, validation)

    def draw(self) -> None:
        """Draw the curves."""
        if self._log is not None:
            self._log.draw()

    def count_timesteps(self, update: int) -> int:
        """Frames seen in the first so many updates."""
        pretraining = self._config.pretraining
        frames = 0 if pretraining is None else min(update, self._first) * pretraining.batch_frames
        return frames + max(0, update - self._first) * self._timesteps_per_update

    def _load(self) -> RunState:
        """What an earlier run has left; no process trains, or writes, before all have read it."""
        folder = self._folder / STATE
        state = load_state(folder, self._trainer)
        (mean,) = self._placement.mean([state.update])
        if mean != state.update:
            raise BadRunState(str(folder), "is not the same in all processes")
        return state

    def _validate(self, update: int) -> ValidationReport | None:
        number = update - self._first
        due = number % self._intervals.validate == 0 or number == self._config.updates
        if not (due and self._holds_out and self._placement.leads):
            return None
        report = self._trainer.validate(self._loader)
        self._progress.validated(update, report)
        return report

    def _write(
        self,
        update: int,
        report: UpdateReport | PretrainingReport,
        validation: ValidationReport | None,
        clock: _Clock,
    ) -> None:
        if self._log is None:
            return
        held_out = {} if validation is None else asdict(validation)
        timesteps = self.count_timesteps(update)
        success_rate = None
        if self._evaluate is not None and validation is not None:
            success_rate = self._evaluate(self._trainer, update)
        self._log.append(
            {
                "update": update,
                "timesteps": timesteps,
                "wall_s": round(clock.trained_s, 3),
                "timesteps_per_s": round(clock.rate(timesteps), 1),
                **asdict(report),
                **{f"validation_{name}": value for name, value in held_out.items()},
                "success_rate": success_rate,
            }
        )

    def _save(self, update: int, trained_s: float) -> None:
        if self._placement.leads:
            state = RunState(update=update, trained_s=trained_s)
            save_state(self._folder / STATE, self._trainer, state)


class _Clock:
    """Time spent on a run, the rate since the last look, and when to save.

    Args:
        before_s: Spent before this process.
    """

    def __init__(self, before_s: float) -> None:
        self._started_s = time.monotonic() - before_s
        self._saved_s = time.monotonic()
        self._seen: tuple[float, int] | None = None

    @property
    def trained_s(self) -> float:
        """All of it."""
        return time.monotonic() - self._started_s

    def save_is_due(self) -> bool:
        """True every two minutes."""
        now_s = time.monotonic()
        if now_s - self._saved_s < _SAVE_S:
            return False
        self._saved_s = now_s
        return True

    def rate(self, timesteps: int) -> float:
        """Frames per second since it was last asked."""
        before, self._seen = self._seen, (time.monotonic(), timesteps)
        if before is None:
            return timesteps / max(self.trained_s, 1e-9)
        return (timesteps - before[1]) / max(self._seen[0] - before[0], 1e-9)


def _claim(folder: Path, config: TrainingConfig, data_sha256: str) -> None:
    """Make the folder, or see that it holds this run."""
    path = folder / CONFIG
    ours = {**config.model_dump(mode="json"), DATA: data_sha256}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not path.is_file():
            path.write_text(json.dumps(ours, indent=2) + "\n")
            return
        theirs = json.loads(path.read_bytes())
    except OSError as error:
        raise NotWritable(str(folder), error.strerror or str(error)) from error
    except ValueError as error:
        raise BadRunState(str(path), "is not JSON") from error
    mine, stored = flatten(ours), flatten(theirs)
    for field in sorted({*mine, *stored}):
        if mine.get(field) != stored.get(field):
            raise OtherRun(str(folder), field, stored.get(field), mine.get(field))


def flatten(fields: Mapping[str, Any], prefix: str = "") -> dict[str, object]:
    """Values of nested objects by their path, e.g. `network.window`."""
    flat: dict[str, object] = {}
    for name, value in fields.items():
        if isinstance(value, dict):
            flat |= flatten(cast("dict[str, Any]", value), f"{prefix}{name}.")
        else:
            flat[prefix + name] = value
    return flat
