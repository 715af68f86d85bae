"""Evaluations over REST by somebody who does not give up when the control plane is away."""

from __future__ import annotations

import time
from collections.abc import Sequence

from client.api import LegatoClient
from client.errors import ControlUnreachable, RestError
from common.api import EvaluationRequest, Trial

ENDED = ("success", "failure", "aborted")
POLL_S = 0.1
UNAVAILABLE = 503
FIRST_SEED = 1000


class Workload:
    """Keeps some evaluations running until all have ended, and remembers what it was told.

    Args:
        client: Of the control plane.
        requests: One per evaluation; no two are equal, so that each is known by its request.
        at_once: Evaluations that run at the same time.
    """

    def __init__(
        self, client: LegatoClient, requests: Sequence[EvaluationRequest], *, at_once: int = 2
    ) -> None:
        self.ended: dict[tuple[str, int], Trial] = {}
        """Every trial that was shown as ended, as it was when that was first seen."""
        self._client = client
        self._waiting = list(reversed(requests))
        self._at_once = at_once
        self._running: set[str] = set()

    def run(self, *, deadline_s: float) -> None:
        """Return when every evaluation has ended.

        Raises:
            TimeoutError: Some have not, in time.
        """
        until_s = time.monotonic() + deadline_s
        while self._waiting or self._running:
            if time.monotonic() > until_s:
                still = f"{sorted(self._running)} run, {len(self._waiting)} wait"
                raise TimeoutError(f"after {deadline_s:.0f} s {still}")
            try:
                self._step()
            except ControlUnreachable:
                # Killed, and about to come back.
                pass
            except RestError as error:
                if error.problem.status != UNAVAILABLE:
                    raise
            time.sleep(POLL_S)

    def _step(self) -> None:
        if self._waiting and len(self._running) < self._at_once:
            self._running.add(self._submit(self._waiting[-1]))
            self._waiting.pop()
        for identifier in sorted(self._running):
            status = self._client.evaluation(identifier).status
            for trial in self._client.trials(identifier):
                if trial.status in ENDED:
                    self.ended.setdefault((identifier, trial.id), trial)
            if status != "running":
                self._running.remove(identifier)

    def _submit(self, request: EvaluationRequest) -> str:
        # An answer may have been lost with a control plane that had written the request down.
        for each in self._client.evaluations():
            if each.request == request:
                return each.id
        return self._client.submit(request).id


def make_requests(count: int) -> list[EvaluationRequest]:
    """Small evaluations: short trials on one robot or two, and now and then a whole one."""
    return [_make_request(number) for number in range(count)]


def _make_request(number: int) -> EvaluationRequest:
    both = number % 2 == 1
    return EvaluationRequest(
        tasks=["lid" if number % 10 == 3 else "cup"],
        robots=["abstract", "panda"] if both else ["abstract"],
        policy="expert",
        trials=1 if both else 2,
        seed=FIRST_SEED + number,
        pictures=False,
    )
