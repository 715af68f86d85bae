"""A few trials of LEGATO's full loop in this process, timed; prints one JSON object.

Lid task, Panda, expert: physics at 500 Hz, retargeting and gripper at 100 Hz, the stereo pair with
shadows and the policy at 10 Hz, in lockstep and without pictures for reports.
"""

from __future__ import annotations

import argparse
import json
import sys
import threading
import time
from types import TracebackType
from typing import Self

from client.offline import run_in_process
from client.record import EvaluationRecord
from common.api import EvaluationRequest, ProgressEvent

CAMERA = "t265"


class EndTimes:
    """A progress display that notes when each trial ended: wall and CPU time of the process [s]."""

    def __init__(self) -> None:
        self.wall_s: list[float] = []
        self.cpu_s: list[float] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Nothing to leave."""

    def update(self, event: ProgressEvent) -> None:
        """Note the time when the event is the end of a trial."""
        if event.trial is not None and event.trial.status not in ("pending", "running"):
            self.wall_s.append(time.perf_counter())
            self.cpu_s.append(time.process_time())


def run_trials(trials: int, seed: int, times: EndTimes) -> EvaluationRecord:
    """Run one trial to warm up and then the ones that count."""
    request = EvaluationRequest(
        tasks=["lid"],
        robots=["panda"],
        policy="expert",
        trials=1 + trials,
        seed=seed,
        camera=CAMERA,
        pictures=False,
    )
    return run_in_process(request, progress=times, stop=threading.Event())


def read_sim_times(record: EvaluationRecord) -> list[float]:
    """Simulated time of each trial [s], in order.

    Raises:
        SystemExit: A trial did not succeed; its time would be that of something else.
    """
    failed = [t for t in record.trials if t.status != "success"]
    if failed:
        raise SystemExit(", ".join(f"trial {t.index} {t.status}: {t.reason}" for t in failed))
    return [trial.result.sim_time_s for trial in record.trials if trial.result is not None]


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=3)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()

    times = EndTimes()
    sim_s = sum(read_sim_times(run_trials(args.trials, args.seed, times))[1:])
    measured = {
        "sim_s": sim_s,
        # From the end of the trial before: set-up, scheduling and the result are in it.
        "wall_s": times.wall_s[-1] - times.wall_s[0],
        "cpu_s": times.cpu_s[-1] - times.cpu_s[0],
        "reset_wall_s": 0.0,
    }
    print(json.dumps(measured))
    return 0


if __name__ == "__main__":
    sys.exit(main())
