"""What the REST handlers work with, and the checks of a request."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from fastapi import Depends, Request

from common.api import (
    CellInfo,
    Evaluation,
    EvaluationRequest,
    PolicyInfo,
    PolicyLoadRequest,
    ProgressEvent,
    ResetRequest,
    StopRequest,
)
from common.errors import ConfigError, NotReady, UnknownName, UntrainedTask
from common.messages import LocalMessage
from services.control.catalog import Catalog
from services.control.deployment import Deployment
from services.control.events import CancelEvaluation, ResetCells, StopCells
from services.control.queries import Queries
from services.control.store import Store
from services.control.subscriptions import Subscriptions


class InvalidRequest(ConfigError):
    """A request that names something that does not exist; `errors` has every such name."""

    def __init__(self, errors: list[tuple[str, ConfigError]]) -> None:
        self.errors = errors
        first = errors[0][1]
        self.first = first
        super().__init__(first.happened, expected=first.expected, action=first.action)

    def describe(self) -> dict[str, str]:
        """The first error speaks for all."""
        return self.first.describe()


@dataclass(frozen=True)
class ControlPlane:
    """The parts behind REST.

    Args:
        store: Writes results.
        queries: Reads them.
        deployment: What runs now.
        catalog: What this code knows.
        subscriptions: Who follows an evaluation.
        send: Hands a message to the scheduler.
    """

    store: Store
    queries: Queries
    deployment: Deployment
    catalog: Catalog
    subscriptions: Subscriptions
    send: Callable[[LocalMessage], None]

    def submit(self, request: EvaluationRequest) -> Evaluation:
        """Check a request, write it down and start it.

        Raises:
            InvalidRequest: It names something that does not exist.
            NotReady: A service that it needs is not running.
            InvalidValue: The grid is too large.
        """
        self._check_names(request)
        self._check_services(request)
        submitted = self.store.create(request)
        self.send(submitted)
        return self.queries.evaluation(submitted.evaluation)

    def cancel(self, identifier: str) -> Evaluation:
        """Stop an evaluation; one that has ended stays as it is.

        Raises:
            NotFound: There is none of that id.
        """
        evaluation = self.evaluation(identifier)
        if evaluation.status == "running":
            self.send(CancelEvaluation(identifier))
        return evaluation

    def evaluation(self, identifier: str) -> Evaluation:
        """One evaluation as it is now.

        Raises:
            NotFound: There is none of that id.
        """
        waiting = self.deployment.waiting.get(identifier, ())
        return self.queries.evaluation(identifier, waiting_for=waiting)

    def progress(self, identifier: str, trial: int | None) -> ProgressEvent:
        """An evaluation as it is now, with the trial that changed it."""
        changed = None if trial is None else self.queries.trial(identifier, trial)
        return ProgressEvent(evaluation=self.evaluation(identifier), trial=changed)

    def load_policy(self, name: str, request: PolicyLoadRequest) -> PolicyInfo:
        """Let policy services load a checkpoint under a name, and wait until they have.

        Raises:
            LoadRefused: A service cannot load it.
            NodeTimeout: A service gave no answer.
            NotReady: No policy service is running.
            UnknownName: There is no such policy service.
        """
        running = [node.node for node in self.deployment.ready("policy")]
        if not running:
            raise NotReady("a policy service", self.deployment.running)
        if request.node is not None and request.node not in running:
            raise UnknownName("policy service", request.node, running)
        nodes = running if request.node is None else [request.node]
        orders = self.deployment.loads.open(name, request.folder, nodes)
        for order in orders:
            self.send(order)
        self.deployment.loads.wait(orders)
        return next(info for info in self.deployment.policies() if info.name == name)

    def stop_cells(self, request: StopRequest) -> list[CellInfo]:
        """Stop cells, and wait until their guards have said so.

        Raises:
            NotReady: There is no cell.
            UnknownName: There is no such cell.
            NodeTimeout: A guard has not; the stop is sent on until it has.
        """
        cells = self._find_cells(request.cells)
        self.send(StopCells(cells, "rest", request.reason))
        return self.deployment.cells.wait(
            cells, lambda info: info.emergency_stop, what="confirmation of the emergency stop"
        )

    def reset_cells(self, request: ResetRequest) -> list[CellInfo]:
        """Release what is latched in cells, and wait until their guards have.

        Raises:
            NotReady: There is no cell.
            UnknownName: There is no such cell.
            NodeTimeout: A guard has not, because its robot is not at rest say.
        """
        cells = self._find_cells(request.cells)
        self.send(ResetCells(cells, "rest"))
        return self.deployment.cells.wait(
            cells,
            lambda info: info.status is not None and info.fault is None,
            what="confirmation of the reset",
        )

    def _find_cells(self, names: Sequence[str] | None) -> tuple[str, ...]:
        known = [info.cell for info in self.deployment.cells.infos]
        if not known:
            raise NotReady("a sim service", self.deployment.running)
        for name in names or ():
            if name not in known:
                raise UnknownName("cell", name, known)
        return tuple(known if names is None else names)

    def _check_names(self, request: EvaluationRequest) -> None:
        errors = list(self._unknown_names(request))
        if errors:
            raise InvalidRequest(errors)

    def _unknown_names(self, request: EvaluationRequest) -> Iterator[tuple[str, ConfigError]]:
        groups: list[tuple[str, str, list[str], list[str]]] = [
            ("tasks", "task", request.tasks, self.catalog.task_names),
            ("robots", "robot", request.robots, self.catalog.robot_names),
            ("camera", "camera", [request.camera], list(self.catalog.cameras)),
        ]
        offered = [policy.name for policy in self.deployment.policies()]
        if offered:
            field = "policy" if request.policy is not None else "policies"
            groups.append((field, "policy", request.policy_names, offered))
        for field, kind, names, known in groups:
            for name in names:
                if name not in known:
                    yield field, UnknownName(kind, name, known)
        yield from self._untrained_tasks(request)

    def _untrained_tasks(self, request: EvaluationRequest) -> Iterator[tuple[str, ConfigError]]:
        for info in self.deployment.policies():
            trained = {task for each in info.checkpoints.values() for task in each.tasks}
            if info.name in request.policy_names and trained:
                for task in request.tasks:
                    if task not in trained:
                        yield "tasks", UntrainedTask(info.name, task, sorted(trained))

    def _check_services(self, request: EvaluationRequest) -> None:
        running = self.deployment.running
        for kind in ("sim", "gripper", "policy"):
            if not self.deployment.ready(kind):
                raise NotReady(f"a {kind} service", running)
        without = [name for name in request.robots if name not in self.deployment.robots()]
        if without:
            raise NotReady(f"a retarget service for {', '.join(without)}", running)


def _get_plane(request: Request) -> Any:
    return request.app.state.plane


Plane = Annotated[ControlPlane, Depends(_get_plane)]
