"""Which trial comes next, and which episodes may be stored: the same for any number of workers."""

from __future__ import annotations

from collections.abc import Iterator

from client.recording.errors import YieldTooLow
from client.recording.report import TrialReport

JUDGED_AFTER = 20
"""Trials before the yield is judged; after them at least one in as many must succeed."""


class Ledger:
    """The trials of a recording.

    A trial is handed out only if, whatever the running ones will bring, it is needed: that is
    when successes so far and running trials together are fewer than wanted. So no trial is run
    for nothing, and what is stored are the first successes in the order of the trials.

    Args:
        wanted: Successes to reach.
        trials: Trials that have been settled before, in an earlier run.
        successes: Successes among them.
    """

    def __init__(self, *, wanted: int, trials: int = 0, successes: int = 0) -> None:
        self.wanted = wanted
        self.trials = trials
        self.successes = successes
        self.aborted = 0
        self.last_reason = ""
        self._next = trials
        self._running: set[int] = set()
        self._reports: dict[int, TrialReport] = {}

    @property
    def done(self) -> bool:
        """Whether enough demonstrations have been taken."""
        return self.successes >= self.wanted

    def hand_out(self) -> int | None:
        """The next trial to run, or None if no further one is known to be needed."""
        waiting = sum(1 for report in self._reports.values() if report.outcome == "success")
        if self.successes + waiting + len(self._running) >= self.wanted:
            return None
        trial, self._next = self._next, self._next + 1
        self._running.add(trial)
        return trial

    def settle(self, report: TrialReport) -> None:
        """Note how a trial that was handed out has ended."""
        self._running.remove(report.trial)
        self._reports[report.trial] = report

    def take_ready(self) -> Iterator[TrialReport]:
        """The reports whose turn has come, in the order of the trials.

        Raises:
            YieldTooLow: Fewer than one in twenty succeeds.
        """
        while self.trials in self._reports:
            report = self._reports.pop(self.trials)
            self.trials += 1
            if report.outcome == "success":
                self.successes += 1
            else:
                self.aborted += report.outcome == "aborted"
                self.last_reason = report.reason
            yield report
            judged = self.trials >= JUDGED_AFTER and not self.done
            if judged and self.successes * JUDGED_AFTER < self.trials:
                raise YieldTooLow(self.successes, self.trials, self.last_reason)
