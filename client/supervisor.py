"""Keeps the processes of a deployment running; `python -m client.supervisor` does so detached."""

from __future__ import annotations

import fcntl
import logging
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import IO, Self

from pydantic import BaseModel, ConfigDict

from client.deployment import Deployment, ProcessSpec
from client.interrupts import stop_on_signals
from client.processes import ManagedProcess
from common.errors import AlreadyRunning, NotWritable
from common.log import configure_logging

log = logging.getLogger(__name__)

POLL_S = 0.05
GRACE_S = 8.0
"""Time between SIGTERM and SIGKILL: a session may take 2 s to close, and machines are busy."""
STACKS_S = 0.2
"""Time to write down where a process hangs before it is killed."""


class Supervisor:
    """Starts processes, restarts those that die, and stops them all.

    All of it happens on one thread of its own, so that a signal that interrupts the caller can
    never come between the start of a process and the note that it runs.

    Args:
        processes: What to run, in the order of starting; they are stopped in reverse.
        logs: Folder of the log files.
        on_give_up: Called from the thread with everything that has been given up so far.
    """

    def __init__(
        self,
        processes: Sequence[ProcessSpec],
        *,
        logs: Path,
        on_give_up: Callable[[dict[str, str]], None] | None = None,
    ) -> None:
        try:
            logs.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise NotWritable(str(logs), error.strerror or str(error)) from error
        self._processes = [ManagedProcess(spec, logs=logs) for spec in processes]
        self._on_give_up = on_give_up
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._running = False
        self._stopped = threading.Event()

    def __enter__(self) -> Self:
        # Starts nothing: an interrupt in here would skip `__exit__`.
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.stop()

    def start(self) -> None:
        """Start every process, from now on and again whenever one dies."""
        threading.Thread(target=self._run, name="supervisor").start()

    def stop(self) -> None:
        """Stop every process and return when all are gone."""
        with self._lock:
            self._stop.set()
            running = self._running
        if running:
            self._stopped.wait()

    @property
    def given_up(self) -> dict[str, str]:
        """Nodes that will not be started again, and the last line each logged."""
        return {
            process.spec.node: process.last_line() for process in self._processes if process.gave_up
        }

    @property
    def pids(self) -> dict[str, int]:
        """Process ids of the nodes that run now."""
        running = {process.spec.node: process.pid for process in self._processes}
        return {node: pid for node, pid in running.items() if pid is not None}

    def _run(self) -> None:
        with self._lock:
            # An interrupted `start` may be followed by `stop` before this line is reached.
            if self._stop.is_set():
                return
            self._running = True
        told = 0
        try:
            while not self._stop.is_set():
                now_s = time.monotonic()
                for process in self._processes:
                    process.supervise(now_s)
                given_up = self.given_up
                if len(given_up) > told and self._on_give_up is not None:
                    self._on_give_up(given_up)
                told = len(given_up)
                self._stop.wait(POLL_S)
        finally:
            self._stop_all()
            self._stopped.set()

    def _stop_all(self) -> None:
        for process in reversed(self._processes):
            process.send_signal(signal.SIGTERM)
        deadline_s = time.monotonic() + GRACE_S
        for process in reversed(self._processes):
            if not process.wait(deadline_s - time.monotonic()):
                # Its log then says what it hangs in.
                process.send_signal(signal.SIGUSR1)
                process.wait(STACKS_S)
                log.warning("killed", extra={"node": process.spec.node})
                process.send_signal(signal.SIGKILL)
                process.wait(GRACE_S)


class SupervisorState(BaseModel):
    """What `<data>/supervisor.json` says about a deployment that runs."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    pid: int
    started_at: datetime
    deployment: Deployment
    given_up: dict[str, str] = {}

    def write(self) -> None:
        """Replace the file in one step."""
        path = state_path(self.deployment.data)
        fresh = path.with_suffix(".new")
        fresh.write_text(self.model_dump_json(indent=2) + "\n")
        fresh.replace(path)


def state_path(data: Path) -> Path:
    """The state file of a data folder."""
    return data / "supervisor.json"


def read_state(data: Path) -> SupervisorState | None:
    """State of the deployment that runs on a data folder, or None when none does.

    The lock tells whether it runs, not the file: a killed supervisor leaves its file behind.
    """
    try:
        with (data / "supervisor.lock").open("rb") as lock:
            if _try_lock(lock):
                return None
        return SupervisorState.model_validate_json(state_path(data).read_text())
    except FileNotFoundError:
        return None


@contextmanager
def open_deployment(deployment: Deployment) -> Generator[Supervisor, None, None]:
    """Lock the data folder for a supervisor, which is yet to be started, and stop it at the end.

    Raises:
        AlreadyRunning: Another supervisor works on the data folder.
        NotWritable: The data folder cannot be made or written.
    """
    with _open_lock(deployment.data) as lock:
        # `read_state` holds the lock for an instant: one failure says nothing yet.
        if not any(_try_lock(lock) or time.sleep(0.02) for _ in range(10)):
            raise AlreadyRunning("a deployment", str(deployment.data))
        state = SupervisorState(
            pid=os.getpid(), started_at=datetime.now(UTC), deployment=deployment
        )
        state.write()
        if deployment.metrics_port is not None:
            deployment.write_targets()
        try:
            with Supervisor(
                deployment.processes(),
                logs=deployment.logs,
                on_give_up=lambda nodes: state.model_copy(update={"given_up": nodes}).write(),
            ) as supervisor:
                yield supervisor
        finally:
            state_path(deployment.data).unlink(missing_ok=True)


def _open_lock(data: Path) -> IO[bytes]:
    try:
        data.mkdir(parents=True, exist_ok=True)
        return (data / "supervisor.lock").open("wb")
    except OSError as error:
        raise NotWritable(str(data), error.strerror or str(error)) from error


def _try_lock(lock: IO[bytes]) -> bool:
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def main() -> None:
    """Supervise the deployment given as JSON until SIGTERM or SIGINT."""
    configure_logging("supervisor")
    stop = threading.Event()
    stop_on_signals(stop)
    with open_deployment(Deployment.model_validate_json(sys.argv[1])) as supervisor:
        supervisor.start()
        stop.wait()


if __name__ == "__main__":
    main()
