"""The services and the scheduler inside this process: one thread, no network.

The services are imported when they are used.
"""

from __future__ import annotations

import importlib.metadata
import secrets
import threading
from collections.abc import Callable, Container, Generator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from client.progress import Progress
from client.record import EvaluationRecord
from client.request import Known, check_names
from common import __version__
from common.api import EvaluationRequest, ProgressEvent, Trial
from common.bus import BusSettings, LocalBus, open_session
from common.errors import InvalidValue, MissingExtra, UntrainedTask
from common.lease import LONGEST_LEASE_S
from common.messages import LocalMessage
from common.robots import list_robots
from common.robots.menagerie import find_menagerie
from common.service import Host, InlineRunner, Reactor, Sink
from common.tasks import list_tasks

if TYPE_CHECKING:
    from services.control.events import SubmitEvaluation
    from services.policy.serving.library import Library

CELL = "sim-0"

Keep: TypeAlias = Callable[[Trial, Mapping[str, bytes]], None]
"""Takes a trial that has ended and its pictures as PNG, by name."""


def run_in_process(
    request: EvaluationRequest,
    *,
    progress: Progress,
    stop: threading.Event,
    checkpoints: Mapping[str, Path] | None = None,
) -> EvaluationRecord:
    """Run an evaluation and return what came out of it; nothing is written to disk.

    Args:
        request: The grid.
        progress: Is told how far it is.
        stop: Cancels the evaluation when set; what has ended stays.
        checkpoints: Folders of policies that do not come with LEGATO, by name.

    Raises:
        CheckpointError: A policy's checkpoint cannot be used.
        MissingExtra: A package that some service needs is not installed.
        UnknownNames: Tasks, robots or policies that do not exist.
        UntrainedTask: A policy was not trained for a task.
    """
    with missing_extra_told():
        check_request_here(request, checkpoints=checkpoints)
        library = load_library(request, checkpoints=checkpoints)
    return run_trials(request, library=library, progress=progress, stop=stop)


def run_trials(
    request: EvaluationRequest,
    *,
    library: Library,
    progress: Progress,
    stop: threading.Event,
    only: Container[int] | None = None,
    keep: Keep | None = None,
) -> EvaluationRecord:
    """Run an evaluation, or some of its trials, whose names and policies have been checked.

    Args:
        request: The grid.
        library: The learned policies that it names.
        progress: Is told how far it is.
        stop: Cancels the evaluation when set; what has ended stays.
        only: Numbers of the trials to run; all of the grid without it.
        keep: Is given every trial as it ends, with its pictures by name, before `progress` is told.

    Raises:
        MissingExtra: A package that some service needs is not installed.
    """
    with missing_extra_told():
        results = _Results(progress, keep)
        services = open_services(request.robots, control_sink=results.sink, library=library)
    submitted = results.create(request, only)
    with services as opened:
        opened.wait_until_ready(stop)
        opened.tell(submitted)
        opened.run(until=lambda: results.ended or stop.is_set())
        if not results.ended:
            opened.cancel(submitted.evaluation)
            opened.run(until=lambda: results.ended)
    return results.record(submitted.evaluation)


@dataclass(frozen=True)
class Services:
    """Everything an episode takes, running in this thread."""

    control: Host
    runner: InlineRunner
    is_ready: Callable[[], bool]

    def run(self, *, until: Callable[[], bool]) -> None:
        """Let everybody work until the condition holds."""
        self.runner.run(until=until)

    def wait_until_ready(self, stop: threading.Event) -> None:
        """Let everybody work until the scheduler knows a node of every kind."""
        self.run(until=lambda: self.is_ready() or stop.is_set())

    def tell(self, event: LocalMessage) -> None:
        """Hand the scheduler an event."""
        self.control.inbox.put_event(event)

    def cancel(self, evaluation: str) -> None:
        """Let the scheduler stop an evaluation."""
        from services.control.events import CancelEvaluation

        self.tell(CancelEvaluation(evaluation))


@contextmanager
def missing_extra_told() -> Generator[None, None, None]:
    """Name the extra when a package of a service is not installed."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise MissingExtra(error.name or "of a service", "all") from error


def check_request_here(
    request: EvaluationRequest, *, checkpoints: Mapping[str, Path] | None = None
) -> None:
    """Refuse names that do not exist in this installation.

    Raises:
        InvalidValue: A checkpoint has the name of a policy that comes with the code.
        UnknownNames: Lists all of them.
    """
    from services.policy.registry import BUILT_IN
    from services.policy.serving.library import find_shipped

    given = checkpoints or {}
    for name in given.keys() & BUILT_IN.keys():
        raise InvalidValue("policy", name, f"a name other than {', '.join(sorted(BUILT_IN))}")
    policies = sorted({*BUILT_IN, *find_shipped(), *given})
    check_names(request, Known(list_tasks(), list_robots(), policies))


def load_library(
    request: EvaluationRequest, *, checkpoints: Mapping[str, Path] | None = None
) -> Library:
    """The learned policies that a request names.

    Raises:
        CheckpointError: One of them cannot be used.
        UntrainedTask: One of them was not trained for a task of the request.
    """
    from services.policy.serving.library import Library, find_shipped

    found = {**find_shipped(), **(checkpoints or {})}
    library = Library()
    library.load_all({name: found[name] for name in request.policy_names if name in found})
    for name, description in library.describe().items():
        for task in request.tasks:
            if task not in description.tasks:
                raise UntrainedTask(name, task, description.tasks)
    return library


def open_services(
    robots: Sequence[str],
    *,
    control_sink: Sink,
    recorder: tuple[Reactor, Sink] | None = None,
    library: Library | None = None,
) -> AbstractContextManager[Services]:
    """The services of an episode and the scheduler.

    Args:
        robots: Robots that get a retargeter.
        control_sink: Takes what the scheduler tells.
        recorder: Listens to the frames; it hears a result before the scheduler does.
        library: Learned policies; none without it.

    Raises:
        ModuleNotFoundError: A package of a service is not installed.
    """
    from services.gripper.reactor import GripperReactor
    from services.policy.reactor import PolicyReactor
    from services.retarget.reactor import RetargetReactor
    from services.sim.reactor import SimReactor

    nodes: list[tuple[str, Reactor]] = [
        (CELL, SimReactor(node=CELL, meshes=find_menagerie())),
        ("retarget", RetargetReactor(node="retarget", robots=robots)),
        ("gripper", GripperReactor(node="gripper")),
        ("policy", PolicyReactor(node="policy", library=library)),
    ]
    return _open(nodes, control_sink, recorder)


def list_software() -> dict[str, str]:
    """Versions of the code and of the packages that shape what is simulated.

    Raises:
        ModuleNotFoundError: A package of a service is not installed.
    """
    from services.policy.reactor import PolicyReactor
    from services.retarget.reactor import RetargetReactor
    from services.sim.reactor import SimReactor

    shaping = (*SimReactor.packages, *RetargetReactor.packages, *PolicyReactor.packages)
    versions = {name: importlib.metadata.version(name) for name in sorted(set(shaping))}
    return {"legato": __version__, **versions}


@contextmanager
def _open(
    nodes: Sequence[tuple[str, Reactor]],
    control_sink: Sink,
    recorder: tuple[Reactor, Sink] | None,
) -> Generator[Services, None, None]:
    from services.control.deployment import Deployment
    from services.control.events import NodesChanged
    from services.control.scheduler import Scheduler

    deployment = Deployment()

    def sink(event: LocalMessage) -> None:
        if isinstance(event, NodesChanged):
            deployment.nodes = event.nodes
        control_sink(event)

    settings = BusSettings(profile="in_process", namespace=f"offline-{secrets.token_hex(4)}")
    with open_session(settings) as session, LocalBus(session) as bus:
        # Nobody can be lost, but the machine may stand still for a while.
        control = Host(Scheduler(lease_s=LONGEST_LEASE_S), bus, node="control", sink=sink)
        hosts = [Host(each, bus, node=node) for node, each in nodes]
        if recorder is not None:
            listener, recorder_sink = recorder
            hosts.append(Host(listener, bus, node="recorder", sink=recorder_sink))
        runner = InlineRunner([*hosts, control])
        runner.start()
        yield Services(control, runner, lambda: not deployment.missing())


class _Results:
    """The results in memory, told to a progress display as they come."""

    def __init__(self, progress: Progress, keep: Keep | None) -> None:
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
        self._keep = keep
        self.sink = ResultSink(self._store, self._deployment, self._show)
        self.ended = False

    def create(self, request: EvaluationRequest, only: Container[int] | None) -> SubmitEvaluation:
        """A new evaluation."""
        return self._store.create(request, only=only)

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
        if self._keep is not None and changed is not None and changed.ended:
            names = changed.pictures
            self._keep(
                changed, {n: self._queries.picture(identifier, changed.id, n) for n in names}
            )
        self._progress.update(ProgressEvent(evaluation=evaluation, trial=changed))
        self.ended = evaluation.status != "running"
