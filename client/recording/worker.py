"""A process that runs one trial after another: orders on standard input, reports on output.

An order is a line with the number of a trial, a report a line of JSON. It ends when its input
ends, also in the middle of a trial: whoever gave the orders is gone then.
"""

from __future__ import annotations

import queue
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TextIO

from client.offline import Services, open_services
from client.recording.parts import write_part
from client.recording.report import TrialReport, WorkerOrder
from common.api import EvaluationRequest
from common.datasets import EpisodeMetadata
from common.errors import LegatoError
from common.messages import LocalMessage
from services.control.events import EvaluationEnded, SubmitEvaluation, TrialEnded, TrialSpec
from services.control.grid import trial_seed
from services.recorder.events import EpisodeIncomplete, RecordedEpisode
from services.recorder.reactor import RecorderReactor


class Demonstrator:
    """Runs trials in this process and keeps what was recorded.

    Args:
        order: What to record.
        stop: Ends a running trial when set.
    """

    def __init__(self, order: WorkerOrder, stop: threading.Event) -> None:
        self._order = order
        self._stop = stop
        self._request = EvaluationRequest(
            tasks=[order.task],
            robots=[order.robot],
            policy=order.policy,
            trials=1,
            seed=order.seed,
            camera=order.camera,
            pictures=False,
        )
        self._recorded: RecordedEpisode | None = None
        self._incomplete: EpisodeIncomplete | None = None
        self._ended: TrialEnded | None = None
        self._over = False

    def run(self, trial: int, services: Services) -> TrialReport | None:
        """Run a trial, write its episode if it is one to keep; None if it was stopped."""
        self._recorded = self._incomplete = self._ended = None
        self._over = False
        services.tell(self._submit(trial))
        services.run(until=lambda: self._over or self._stop.is_set())
        return None if self._ended is None else self._conclude(self._ended)

    def take_recorder(self, event: LocalMessage) -> None:
        """Take what the recorder tells."""
        if isinstance(event, RecordedEpisode):
            self._recorded = event
        elif isinstance(event, EpisodeIncomplete):
            self._incomplete = event

    def take_control(self, event: LocalMessage) -> None:
        """Take what the scheduler tells."""
        if isinstance(event, TrialEnded):
            self._ended = event
        elif isinstance(event, EvaluationEnded):
            self._over = True

    def _submit(self, trial: int) -> SubmitEvaluation:
        order, name = self._order, f"record-{trial}"
        seed = trial_seed(order.seed, trial)
        spec = TrialSpec(name, 0, trial, order.task, order.robot, order.policy, seed)
        request = order.variation.apply(self._request, seed=seed)
        return SubmitEvaluation(name, request, (spec,))

    def _conclude(self, ended: TrialEnded) -> TrialReport:
        trial, seed = ended.trial.index, ended.trial.seed
        if self._incomplete is not None:
            reason = f"not recorded: {self._incomplete.problem}"
            return TrialReport(trial=trial, seed=seed, outcome="aborted", reason=reason)
        stored = False
        if self._recorded is not None and ended.status != "aborted":
            stored = ended.status == "success" or self._order.keep_failed
            if stored:
                metadata = describe_episode(self._recorded, trial=trial)
                write_part(Path(self._order.parts), self._recorded.rows, metadata)
        return TrialReport(
            trial=trial,
            seed=seed,
            outcome=ended.status,
            reason=ended.reason,
            sim_time_s=0.0 if ended.result is None else ended.result.sim_time_s,
            stored=stored,
        )


def describe_episode(recorded: RecordedEpisode, *, trial: int) -> EpisodeMetadata:
    """What is kept of an episode beside its rows: nothing that differs between two runs."""
    result = recorded.result
    if result.outcome == "aborted":
        raise ValueError("an aborted episode is not recorded")
    return EpisodeMetadata(
        trial=trial,
        seed=recorded.configure.seed,
        outcome=result.outcome,
        details={
            "reason": result.reason,
            "failed_conditions": list(result.failed_conditions),
            "stages": result.stages.model_dump(),
            "sim_time_s": result.sim_time_s,
            "goal_distance_m": result.goal_distance_m,
            "hand_error_p95_m": result.hand_error_m.p95,
            "idle_rows_dropped": recorded.idle_rows,
            "tracking_lag_s": recorded.configure.tracking_lag_s,
            "action_latency_s": recorded.configure.action_latency_s,
            "trace_sha256": result.trace_sha256,
        },
    )


class Orders:
    """The lines of standard input, read on a thread so that their end is noticed at once."""

    def __init__(self, stream: TextIO, stop: threading.Event) -> None:
        self._stream = stream
        self._stop = stop
        self._queue: queue.SimpleQueue[int | None] = queue.SimpleQueue()
        threading.Thread(target=self._read, daemon=True).start()

    def __iter__(self) -> Iterator[int]:
        return iter(self._queue.get, None)

    def _read(self) -> None:
        for line in self._stream:
            self._queue.put(int(line))
        self._stop.set()
        self._queue.put(None)


def work(order: WorkerOrder, *, orders: TextIO, reports: TextIO) -> None:
    """Run the trials that are ordered until there are no more orders."""
    stop = threading.Event()
    demonstrator = Demonstrator(order, stop)
    recorder = (RecorderReactor(), demonstrator.take_recorder)
    with open_services(
        [order.robot], control_sink=demonstrator.take_control, recorder=recorder
    ) as services:
        services.wait_until_ready(stop)
        for trial in Orders(orders, stop):
            report = demonstrator.run(trial, services)
            if report is None:
                return
            reports.write(report.model_dump_json() + "\n")
            reports.flush()


def main() -> int:
    """Work as the first argument says; an error is one line on standard error."""
    try:
        order = WorkerOrder.model_validate_json(sys.argv[1])
        work(order, orders=sys.stdin, reports=sys.stdout)
    except LegatoError as error:
        sys.stderr.write(f"{error.code}  {error}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
