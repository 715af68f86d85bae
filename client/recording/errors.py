"""Errors of recording; they belong to the tree of `common.errors`.

LegatoError
├─ LinkError    WorkerDied
└─ StoreError   YieldTooLow
"""

from __future__ import annotations

from common.errors import LinkError, StoreError


class WorkerDied(LinkError):
    """A process that made demonstrations has ended by itself."""

    code = "E-WORKER-DIED"

    def __init__(self, worker: int, trial: int | None, reason: str) -> None:
        self.worker = worker
        self.trial = trial
        self.reason = reason
        at = "without a trial" if trial is None else f"in trial {trial}"
        super().__init__(
            f"worker {worker} ended {at}: {reason}",
            expected="expected it to work until it is told to stop",
            action="what is complete is kept; run the same command again to go on",
        )


class YieldTooLow(StoreError):
    """So few trials succeed that the wanted number will not be reached in any useful time."""

    code = "E-YIELD"

    def __init__(self, successes: int, trials: int, last_reason: str) -> None:
        self.successes = successes
        self.trials = trials
        self.last_reason = last_reason
        super().__init__(
            f"{successes} of {trials} trials succeeded (last failure: {last_reason})",
            expected="expected at least 1 in 20",
            action="look at the failures with: legato eval --policy expert --report report.html",
        )
