"""Records a plan: workers make episodes, this process appends them in the order of the trials."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass

from client.recording.ledger import Ledger
from client.recording.parts import clear_parts, list_parts, part_path, read_part
from client.recording.plan import Plan
from client.recording.pool import WorkerPool
from client.recording.progress import RecordingProgress
from client.recording.report import TrialReport, WorkerOrder
from common.datasets import DatasetSpec, EpisodeWriter
from common.datasets.errors import BadDataset

PARTS = "parts"
_LOOK_S = 0.2
"""How often an interrupt is looked for."""


@dataclass(frozen=True)
class Summary:
    """What has been recorded when the command ends.

    Args:
        episodes: Stored, in all.
        successes: Successes among them.
        trials: Trials that were needed for them, in all.
        aborted: Trials of this run that could not be run to their end.
        rows: Rows of all episodes.
        size_bytes: Their size.
        wall_time_s: Of this run.
    """

    episodes: int
    successes: int
    trials: int
    aborted: int
    rows: int
    size_bytes: int
    wall_time_s: float


def record(
    plan: Plan, spec: DatasetSpec, *, progress: RecordingProgress, stop: threading.Event
) -> Summary:
    """Record what is still missing of a plan.

    Args:
        plan: What to record.
        spec: Its description.
        progress: Is told how far it is.
        stop: Ends the recording when set; what is complete stays.

    Raises:
        StoreError: The folder cannot be used, or the disk is full.
        WorkerDied: A worker has ended by itself.
        YieldTooLow: Too few trials succeed.
    """
    started_s = time.monotonic()
    with EpisodeWriter.open(plan.folder, spec) as writer:
        parts = plan.folder / PARTS
        parts.mkdir(exist_ok=True)
        ledger = _resume(plan, writer)
        progress.begin(ledger)
        if not ledger.done:
            _Recording(plan, writer, ledger, progress).run(stop)
        if ledger.done:
            clear_parts(parts)
        return Summary(
            episodes=len(writer.episodes),
            successes=ledger.successes,
            trials=ledger.trials,
            aborted=ledger.aborted,
            rows=writer.rows,
            size_bytes=writer.rows * spec.row_bytes,
            wall_time_s=time.monotonic() - started_s,
        )


def _resume(plan: Plan, writer: EpisodeWriter) -> Ledger:
    """Where the last run of the same command has stopped.

    Trials that are not stored and lie before the last stored one have failed.
    """
    episodes = writer.episodes
    return Ledger(
        wanted=plan.episodes,
        trials=episodes[-1].trial + 1 if episodes else 0,
        successes=sum(1 for episode in episodes if episode.outcome == "success"),
    )


class _Recording:
    """The work between opening the data set and closing it."""

    def __init__(
        self, plan: Plan, writer: EpisodeWriter, ledger: Ledger, progress: RecordingProgress
    ) -> None:
        self._parts = plan.folder / PARTS
        self._writer = writer
        self._ledger = ledger
        self._progress = progress
        self._waiting = list_parts(self._parts)
        self._order = WorkerOrder(
            task=plan.request.tasks[0],
            robot=plan.request.robots[0],
            camera=plan.request.camera,
            policy=plan.request.policy_names[0],
            seed=plan.request.seed,
            keep_failed=plan.keep_failed,
            variation=plan.variation,
            parts=str(self._parts),
        )
        self._workers = plan.workers

    def run(self, stop: threading.Event) -> None:
        """Hand out trials and append episodes until there are enough, or it is stopped."""
        with WorkerPool(self._order, count=self._workers) as pool:
            while not self._ledger.done and not stop.is_set():
                self._hand_out(pool)
                report = pool.next_report(timeout_s=_LOOK_S)
                if report is not None:
                    self._settle(report)

    def _hand_out(self, pool: WorkerPool) -> None:
        for worker in pool.idle():
            trial = self._next_trial()
            if trial is None:
                return
            worker.run(trial)

    def _next_trial(self) -> int | None:
        """The next trial to run; those whose episode waits from an earlier run are settled."""
        while (trial := self._ledger.hand_out()) is not None:
            if trial not in self._waiting:
                return trial
            part = read_part(self._parts, trial)
            if part is None:
                return trial
            _, metadata = part
            self._settle(
                TrialReport(
                    trial=trial,
                    seed=metadata.seed,
                    outcome=metadata.outcome,
                    reason=str(metadata.details["reason"]),
                    stored=True,
                )
            )
        return None

    def _settle(self, report: TrialReport) -> None:
        """Note a trial's end and append every episode whose turn has come."""
        self._ledger.settle(report)
        for ready in self._ledger.take_ready():
            if ready.stored:
                self._append(ready.trial)
            self._progress.update(self._ledger, ready)

    def _append(self, trial: int) -> None:
        part = read_part(self._parts, trial)
        if part is None:
            raise BadDataset(str(part_path(self._parts, trial)), "has been damaged or removed")
        self._writer.append(*part)
        part_path(self._parts, trial).unlink()
