"""One child process that is kept running: start, restart with growing pauses, stop."""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from client.deployment import ProcessSpec
from common.process import METRICS_PORT

log = logging.getLogger(__name__)

FIRST_PAUSE_S = 0.2
LONGEST_PAUSE_S = 5.0
SETTLED_S = 10.0
"""A process that ran this long is healthy: its earlier deaths are forgotten."""
EARLY_S = 2.0
"""An error within this time of the start is one of starting."""
EARLY_ERRORS = 3


@dataclass
class RestartPolicy:
    """Decides how long to wait before a dead process is started again, or to give up."""

    deaths: int = 0
    early_errors: int = 0

    def pause_s(self, *, lifetime_s: float, code: int) -> float | None:
        """Judge one death.

        The first restart is immediate, then 0.2 s, 0.4 s and so on up to 5 s.

        Args:
            lifetime_s: How long the process ran.
            code: Its exit code; a negative one is a signal.

        Returns:
            Pause before the next start [s], or None: exit code 1 within 2 s, three times running.
        """
        if lifetime_s >= SETTLED_S:
            self.deaths = 0
        self.early_errors = self.early_errors + 1 if code == 1 and lifetime_s < EARLY_S else 0
        if self.early_errors >= EARLY_ERRORS:
            return None
        self.deaths += 1
        if self.deaths == 1:
            return 0.0
        return min(LONGEST_PAUSE_S, FIRST_PAUSE_S * 2.0 ** (self.deaths - 2))


class ManagedProcess:
    """A service of the deployment as a child of this process.

    Args:
        spec: What to run.
        logs: Folder of the log file, which is appended to.
    """

    def __init__(self, spec: ProcessSpec, *, logs: Path) -> None:
        self.spec = spec
        self.log_path = logs / f"{spec.node}.log"
        self.gave_up = False
        self._policy = RestartPolicy()
        self._process: subprocess.Popen[bytes] | None = None
        self._started_s = 0.0
        self._start_at_s = 0.0

    @property
    def pid(self) -> int | None:
        """Process id while it runs."""
        return None if self._process is None else self._process.pid

    def supervise(self, now_s: float) -> None:
        """Start it when due, notice its death.

        Args:
            now_s: Monotonic time.
        """
        if self._process is not None:
            code = self._process.poll()
            if code is not None:
                self._process = None
                self._bury(code, now_s)
        if self._process is None and not self.gave_up and now_s >= self._start_at_s:
            self._start(now_s)

    def send_signal(self, number: signal.Signals) -> None:
        """Signal it, if it runs."""
        if self._process is not None:
            self._process.send_signal(number)

    def wait(self, timeout_s: float) -> bool:
        """Wait for its end; tell whether it has ended."""
        if self._process is not None:
            try:
                self._process.wait(timeout=max(0.0, timeout_s))
            except subprocess.TimeoutExpired:
                return False
            self._process = None
        return True

    def last_line(self) -> str:
        """The last line of its log that says something."""
        return read_last_line(self.log_path)

    def _start(self, now_s: float) -> None:
        with self.log_path.open("ab") as output:
            self._process = spawn(
                self.spec.module, (*self.spec.arguments, f"--parent-pid={os.getpid()}"), output
            )
        self._started_s = now_s
        log.info("started", extra={"node": self.spec.node, "pid": self._process.pid})

    def _bury(self, code: int, now_s: float) -> None:
        pause_s = self._policy.pause_s(lifetime_s=now_s - self._started_s, code=code)
        self.gave_up = pause_s is None
        self._start_at_s = now_s + (pause_s or 0.0)
        log.warning(
            "died", extra={"node": self.spec.node, "exit_code": code, "restart_in_s": pause_s}
        )


def spawn(module: str, arguments: tuple[str, ...], output: IO[bytes]) -> subprocess.Popen[bytes]:
    """Run a module of this installation in its own session, so that Ctrl-C does not reach it.

    One thread per process for linear algebra: the matrices are small and the processes many. A port
    for metrics comes by option or not at all: one in the environment could go to one process only.
    """
    inherited = {name: value for name, value in os.environ.items() if name != METRICS_PORT}
    return subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        stdin=subprocess.DEVNULL,
        stdout=output,
        stderr=subprocess.STDOUT,
        start_new_session=True,
        env=inherited | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
    )


def read_last_line(path: Path) -> str:
    """The last line of a file that is not empty; an empty text when there is none."""
    try:
        with path.open("rb") as file:
            file.seek(0, os.SEEK_END)
            file.seek(max(0, file.tell() - 8192))
            lines = file.read().decode(errors="replace").splitlines()
    except FileNotFoundError:
        return ""
    return next((line.strip() for line in reversed(lines) if line.strip()), "")
