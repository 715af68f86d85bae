"""An evaluation inside this process: the same services and scheduler, one thread, no network.

The services are imported when they are used.
"""

from __future__ import annotations

import secrets
import threading
from typing import TYPE_CHECKING

from client.progress import Progress
from client.record import EvaluationRecord
from client.request import Known, check_names
from common.api import EvaluationRequest, ProgressEvent
from common.bus import BusSettings, LocalBus, open_session
from common.errors import MissingExtra
from common.robots import list_robots
from common.service import Host, InlineRunner, Reactor
from common.tasks import list_tasks

if TYPE_CHECKING:
    from services.control.events import SubmitEvaluation

CELL = "sim-0"


def run_in_process(
    request: EvaluationRequest, *, progress: Progress, stop: threading.Event
) -> EvaluationRecord:
    """Run an evaluation and return what came out of it; nothing is written to disk.

    Args:
        request: The grid.
        progress: Is told how far it is.
        stop: Cancels the evaluation when set; what has ended stays.

    Raises:
        MissingExtra: A package that some service needs is not installed.
        UnknownNames: Tasks, robots or policies that do not exist.
    """
    try:
        nodes = _build_nodes(request)
        results = _Results(progress)
    except ModuleNotFoundError as error:
        raise MissingExtra(error.name or "of a service", "all") from error
    submitted = results.create(request)
    _drive(nodes, results, submitted, stop)
    return results.record(submitted.evaluation)


class _Results:
    """The results in memory, told to a progress display as they come."""

    def __init__(self, progress: Progress) -> None:
        from services.control.database import IN_MEMORY, Database
        from services.control.deployment import Deployment
        from services.control.queries import Queries
        from services.control.sink import ResultSink
        from services.control.store import Store

        database = Database(IN_MEMORY)
        self._store = Store(database, namespace="offline")
        self._queries = Queries(database, namespace="offline")
        self._deployment = Deployment()
        self._progress = progress
        self.sink = ResultSink(self._store, self._deployment, self._show)
        self.ended = False

    @property
    def ready(self) -> bool:
        """Whether the scheduler knows a node of every kind."""
        return not self._deployment.missing()

    def create(self, request: EvaluationRequest) -> SubmitEvaluation:
        """A new evaluation."""
        return self._store.create(request)

    def record(self, identifier: str) -> EvaluationRecord:
        """What came out of it."""
        return EvaluationRecord(
            evaluation=self._queries.evaluation(identifier),
            trials=self._queries.trials(identifier),
            picture=lambda trial, name: self._queries.picture(identifier, trial.id, name),
        )

    def _show(self, identifier: str, trial: int | None) -> None:
        waiting_for = self._deployment.waiting.get(identifier, ())
        evaluation = self._queries.evaluation(identifier, waiting_for=waiting_for)
        changed = None if trial is None else self._queries.trial(identifier, trial)
        self._progress.update(ProgressEvent(evaluation=evaluation, trial=changed))
        self.ended = evaluation.status != "running"


def _build_nodes(request: EvaluationRequest) -> list[tuple[str, Reactor]]:
    """The services of an episode, by node; names are checked before models are built."""
    from services.gripper.reactor import GripperReactor
    from services.policy.reactor import PolicyReactor
    from services.policy.registry import BUILT_IN
    from services.retarget.reactor import RetargetReactor
    from services.sim.reactor import SimReactor

    check_names(request, Known(list_tasks(), list_robots(), sorted(BUILT_IN)))
    return [
        (CELL, SimReactor(node=CELL)),
        ("retarget", RetargetReactor(node="retarget", robots=request.robots)),
        ("gripper", GripperReactor(node="gripper")),
        ("policy", PolicyReactor(node="policy")),
    ]


def _drive(
    nodes: list[tuple[str, Reactor]],
    results: _Results,
    submitted: SubmitEvaluation,
    stop: threading.Event,
) -> None:
    from services.control.events import CancelEvaluation
    from services.control.scheduler import Scheduler

    settings = BusSettings(profile="in_process", namespace=f"offline-{secrets.token_hex(4)}")
    with open_session(settings) as session, LocalBus(session) as bus:
        control = Host(Scheduler(), bus, node="control", sink=results.sink)
        runner = InlineRunner([*(Host(each, bus, node=node) for node, each in nodes), control])
        runner.start()
        runner.run(until=lambda: results.ready or stop.is_set())
        control.inbox.put_event(submitted)
        runner.run(until=lambda: results.ended or stop.is_set())
        if not results.ended:
            control.inbox.put_event(CancelEvaluation(submitted.evaluation))
            runner.run(until=lambda: results.ended)
