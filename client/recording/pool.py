"""The worker processes of a recording."""

from __future__ import annotations

import contextlib
import os
import queue
import signal
import subprocess
import sys
import threading
from pathlib import Path
from types import TracebackType
from typing import IO, Self

from pydantic import ValidationError

from client.recording.errors import WorkerDied
from client.recording.report import TrialReport, WorkerOrder

COMMAND = (sys.executable, "-m", "client.recording.worker")


class Worker:
    """One process and the thread that reads its reports.

    Args:
        number: From 0.
        order: What it is to record.
        reports: Gets (number, report), and (number, None) when the process has ended.
    """

    def __init__(
        self,
        number: int,
        order: WorkerOrder,
        reports: queue.Queue[tuple[int, TrialReport | None]],
    ) -> None:
        self.number = number
        self.trial: int | None = None
        self._fault: str | None = None
        self._log = Path(order.parts) / f"worker-{number}.log"
        with self._log.open("wb") as log:
            self._process = subprocess.Popen(
                [*COMMAND, order.model_dump_json()],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                text=True,
                # One thread each: their number is the parallelism.
                env=os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
                # Ctrl-C goes to the parent alone, which tells them.
                start_new_session=True,
            )
        self._reader = threading.Thread(target=self._read, args=(reports,), daemon=True)
        self._reader.start()

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    def run(self, trial: int) -> None:
        """Let it run a trial. One that has died is told of by its reader."""
        self.trial = trial
        pipe = _pipe(self._process.stdin)
        try:
            pipe.write(f"{trial}\n")
            pipe.flush()
        except BrokenPipeError:
            return

    def close(self) -> None:
        """End it: what it has finished is on the disk, the rest is of no use."""
        self._process.kill()
        self._process.wait()
        self._reader.join()
        with contextlib.suppress(BrokenPipeError):
            _pipe(self._process.stdin).close()
        _pipe(self._process.stdout).close()

    def explain_death(self) -> WorkerDied:
        """Why it has ended."""
        code = self._process.wait()
        lines = self._log.read_text(errors="replace").strip().splitlines()
        said = lines[-1] if lines else f"exit code {code} without a word"
        reason = f"killed by {signal.Signals(-code).name}" if code < 0 else said
        return WorkerDied(self.number, self.trial, self._fault or reason)

    def _read(self, reports: queue.Queue[tuple[int, TrialReport | None]]) -> None:
        for line in _pipe(self._process.stdout):
            try:
                report = TrialReport.model_validate_json(line)
            except ValidationError:
                self._fault = f"wrote {line.strip()!r} instead of a report"
                self._process.kill()
                break
            reports.put((self.number, report))
        reports.put((self.number, None))


class WorkerPool:
    """Several workers. A context manager: leaving it ends them, whatever they are doing.

    Args:
        order: What they are to record.
        count: How many.
    """

    def __init__(self, order: WorkerOrder, *, count: int) -> None:
        # Read by the thread that hears signals: for a SimpleQueue see `Inbox`.
        self._reports: queue.Queue[tuple[int, TrialReport | None]] = queue.Queue()
        self.workers: list[Worker] = []
        for number in range(count):
            self.workers.append(Worker(number, order, self._reports))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for worker in self.workers:
            worker.close()

    def idle(self) -> list[Worker]:
        """Those that have nothing to do."""
        return [worker for worker in self.workers if worker.trial is None]

    def next_report(self, *, timeout_s: float) -> TrialReport | None:
        """Wait for a report; None when there was none in time.

        Raises:
            WorkerDied: A worker has ended.
        """
        try:
            number, report = self._reports.get(timeout=timeout_s)
        except queue.Empty:
            return None
        worker = self.workers[number]
        if report is None:
            raise worker.explain_death()
        worker.trial = None
        return report


def _pipe(stream: IO[str] | None) -> IO[str]:
    if stream is None:
        raise AssertionError("the process was started with pipes")
    return stream
