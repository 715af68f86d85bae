"""Takes what the scheduler tells the edge: writes it down first, then says that it changed."""

from __future__ import annotations

import logging
from collections.abc import Callable

from common.messages import LocalMessage
from services.control.deployment import Deployment
from services.control.events import (
    AttemptEnded,
    AttemptStarted,
    CellsChanged,
    EvaluationEnded,
    NodesChanged,
    PictureArrived,
    PolicyLoadEnded,
    TrialEnded,
    TrialSpec,
    WaitingChanged,
)
from services.control.store import Store

log = logging.getLogger(__name__)

Notify = Callable[[str, int | None], None]
"""Told the evaluation, and the trial that changed it if it was one."""


class ResultSink:
    """The sink of the scheduler's host.

    Args:
        store: Where results go.
        deployment: What the edges read about nodes.
        notify: Told about each change of an evaluation, after it was written.
    """

    def __init__(self, store: Store, deployment: Deployment, notify: Notify) -> None:
        self._store = store
        self._deployment = deployment
        self._notify = notify

    def __call__(self, event: LocalMessage) -> None:
        """Take one event.

        Raises:
            NotWritable: The database refuses.
        """
        match event:
            case NodesChanged():
                self._deployment.nodes = event.nodes
            case CellsChanged():
                self._deployment.cells.put(event.cells)
            case PolicyLoadEnded():
                self._deployment.loads.put(event)
            case PictureArrived():
                self._store.add_picture(event)
            case WaitingChanged():
                self._deployment.set_waiting(event.evaluation, event.names)
                self._notify(event.evaluation, None)
            case EvaluationEnded():
                ended = {"evaluation": event.evaluation, "status": event.status}
                log.info("evaluation ended", extra=ended)
                self._deployment.set_waiting(event.evaluation, ())
                self._store.end_evaluation(event)
                self._notify(event.evaluation, None)
            case AttemptStarted() | AttemptEnded() | TrialEnded():
                self._write_trial(event)
                self._notify(event.trial.evaluation, event.trial.id)
            case _:
                raise TypeError(f"the scheduler sent an unknown event: {event!r}")

    def _write_trial(self, event: AttemptStarted | AttemptEnded | TrialEnded) -> None:
        match event:
            case AttemptStarted():
                self._store.start_attempt(event)
                began = {"attempt": event.number, "cell": event.cell, "epoch": event.epoch}
                log.info("attempt started", extra=_about(event.trial) | began)
            case AttemptEnded():
                self._store.end_attempt(event)
                ended = {"attempt": event.number, "reason": event.reason}
                log.info("attempt aborted", extra=_about(event.trial) | ended)
            case TrialEnded():
                self._store.end_trial(event)
                ended = {"outcome": event.status, "reason": event.reason}
                log.info("trial ended", extra=_about(event.trial) | ended)


def _about(trial: TrialSpec) -> dict[str, object]:
    """Fields that say which trial a line is about, named as in the other processes."""
    return {"evaluation": trial.evaluation, "trial": trial.id}
