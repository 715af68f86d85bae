"""A worker for tests of recording: it makes episodes of numbers and causes trouble when told to."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

import numpy as np

from client.recording.parts import write_part
from client.recording.report import TrialReport, WorkerOrder
from common.datasets import EpisodeMetadata, EpisodeRows


def make_episode(trial: int, outcome: str) -> tuple[EpisodeRows, EpisodeMetadata]:
    values = np.random.default_rng(trial).normal(size=(2 + trial % 3, 3))
    details = {"reason": f"reason {trial}"}
    about = EpisodeMetadata(trial=trial, seed=100 + trial, outcome=outcome, details=details)
    return EpisodeRows({"value": values}), about


def work() -> None:
    """Every third trial fails; the robot's name says what else is to happen, and at which trial."""
    order = WorkerOrder.model_validate_json(sys.argv[1])
    trouble, _, at = order.robot.partition("-")
    for line in sys.stdin:
        trial = int(line)
        if trouble == "crash" and trial == int(at):
            raise RuntimeError("the world ended")
        if trouble == "killed" and trial == int(at):
            os.kill(os.getpid(), signal.SIGKILL)
        outcome = "failure" if trial % 3 == 1 or trouble == "hopeless" else "success"
        outcome = "aborted" if trouble == "aborts" and trial == int(at) else outcome
        stored = outcome == "success" or (outcome == "failure" and order.keep_failed)
        if stored:
            write_part(Path(order.parts), *make_episode(trial, outcome))
        told = TrialReport(
            trial=trial, seed=100 + trial, outcome=outcome, reason="because", stored=stored
        )
        sys.stdout.write(told.model_dump_json() + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    work()
