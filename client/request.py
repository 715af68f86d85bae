"""From the arguments of `legato eval` to a request, with every wrong name found at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pydantic import ValidationError

from client.api import LegatoClient
from client.commands import Eval
from client.errors import UnknownNames
from common.api import EvaluationRequest
from common.errors import InvalidValue, NotReady, UnknownName

DEFAULT_TASKS = ("lid",)
DEFAULT_ROBOTS = ("abstract", "panda")
DEFAULT_POLICIES = ("expert",)

_OPTIONS = {
    "tasks": "--task",
    "robots": "--robot",
    "policies": "--policy",
    "action_latency_s": "--action-latency-ms",
    "tracking_lag_s": "--tracking-lag-ms",
}


@dataclass(frozen=True)
class Known:
    """Names that exist where the evaluation will run."""

    tasks: Sequence[str]
    robots: Sequence[str]
    policies: Sequence[str]


def build_request(command: Eval, *, pictures: bool) -> EvaluationRequest:
    """The request that the arguments mean.

    Raises:
        InvalidValue: A number out of its range, a name twice, or a name that cannot be one.
    """
    try:
        return EvaluationRequest(
            tasks=list(command.task or DEFAULT_TASKS),
            robots=list(command.robot or DEFAULT_ROBOTS),
            policies=list(command.policy or DEFAULT_POLICIES),
            trials=command.trials,
            seed=command.seed,
            mode=command.mode,
            camera=command.camera,
            full_grid=command.full_grid,
            action_latency_s=command.action_latency_ms * 1e-3,
            tracking_lag_s=command.tracking_lag_ms * 1e-3,
            randomise_camera=command.randomise_camera,
            pictures=pictures,
        )
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        if not first["loc"]:
            raise InvalidValue("the grid", "wrong", first["msg"]) from error
        field = str(first["loc"][0])
        option = _OPTIONS.get(field, "--" + field.replace("_", "-"))
        raise InvalidValue(option, first["input"], first["msg"]) from error


def check_names(request: EvaluationRequest, known: Known) -> None:
    """Refuse names that do not exist.

    Raises:
        UnknownNames: Lists all of them.
    """
    wrong = [
        UnknownName(kind, name, names)
        for kind, asked, names in (
            ("task", request.tasks, known.tasks),
            ("robot", request.robots, known.robots),
            ("policy", request.policy_names, known.policies),
        )
        for name in asked
        if name not in names
    ]
    if wrong:
        raise UnknownNames(wrong)


def check_request(client: LegatoClient, request: EvaluationRequest) -> None:
    """Refuse what a control plane does not know, or has no service for.

    Raises:
        NotReady: No policy service, or no retargeter for a robot that exists.
        UnknownNames: Names that do not exist.
    """
    robots, policies = client.robots(), client.policies()
    running = [f"{service.kind}/{service.node}" for service in client.services() if service.alive]
    if not policies:
        raise NotReady("a policy service", running)
    check_names(
        request,
        Known(
            tasks=[task.name for task in client.tasks()],
            robots=[robot.name for robot in robots],
            policies=[policy.name for policy in policies],
        ),
    )
    for robot in robots:
        if robot.name in request.robots and not robot.available:
            raise NotReady(f"a retargeter for {robot.name}", running)
