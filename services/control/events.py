"""What the edges tell the scheduler, and what it tells the store and the browser."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from common.api import CellInfo, EvaluationRequest, ServiceInfo
from common.messages import EpisodePicture, LocalMessage, Problem, TrialResult


@dataclass(frozen=True)
class TrialSpec:
    """One trial of a grid.

    Args:
        evaluation: Id of its evaluation.
        id: Number within the evaluation, in the order of the grid.
        index: i of "trial i": the same seed for every robot and policy.
        task: Task name.
        robot: Robot name.
        policy: Policy name.
        seed: Seed of the episode.
        spent: Attempts that were already made, before a restart say.
    """

    evaluation: str
    id: int
    index: int
    task: str
    robot: str
    policy: str
    seed: int
    spent: int = 0


@dataclass(frozen=True)
class SubmitEvaluation(LocalMessage):
    """Run these trials: a new evaluation, or what is left of one."""

    evaluation: str
    request: EvaluationRequest
    trials: tuple[TrialSpec, ...]


@dataclass(frozen=True)
class CancelEvaluation(LocalMessage):
    """Stop an evaluation; what has ended stays."""

    evaluation: str


@dataclass(frozen=True)
class StopCells(LocalMessage):
    """Stop the robots of these cells and end what runs there.

    Args:
        cells: Names.
        by: Who stops them.
        reason: Why.
    """

    cells: tuple[str, ...]
    by: str
    reason: str


@dataclass(frozen=True)
class ResetCells(LocalMessage):
    """Release what is latched in these cells."""

    cells: tuple[str, ...]
    by: str


@dataclass(frozen=True)
class CellsChanged(LocalMessage):
    """The cells and their safety, as they are now."""

    cells: tuple[CellInfo, ...]


@dataclass(frozen=True)
class LoadPolicy(LocalMessage):
    """Let a policy service load a checkpoint. Answered by `PolicyLoadEnded`.

    Args:
        request: Comes back in the answer.
        node: The policy service.
        policy: Name under which it serves the checkpoint.
        folder: On the service's host.
    """

    request: str
    node: str
    policy: str
    folder: str


@dataclass(frozen=True)
class PolicyLoadEnded(LocalMessage):
    """A policy service has loaded a checkpoint and said what it offers now, or could not."""

    request: str
    problem: Problem | None


@dataclass(frozen=True)
class AttemptStarted(LocalMessage):
    """A trial was handed to a cell.

    Args:
        trial: The trial.
        number: 1 for the first attempt.
        epoch: Epoch of the cell.
        cell: Cell, which is the simulation's node name.
        versions: Code and packages of the nodes that take part.
    """

    trial: TrialSpec
    number: int
    epoch: int
    cell: str
    versions: dict[str, str]


@dataclass(frozen=True)
class AttemptEnded(LocalMessage):
    """An attempt was aborted and the trial waits for another one."""

    trial: TrialSpec
    number: int
    reason: str


@dataclass(frozen=True)
class TrialEnded(LocalMessage):
    """A trial has ended, and with it its running attempt if it has one."""

    trial: TrialSpec
    status: Literal["success", "failure", "aborted"]
    reason: str
    result: TrialResult | None = None


@dataclass(frozen=True)
class PictureArrived(LocalMessage):
    """A picture of a trial's key moment."""

    trial: TrialSpec
    picture: EpisodePicture


@dataclass(frozen=True)
class EvaluationEnded(LocalMessage):
    """Nothing of an evaluation is left to do. `cancelled` closes whatever was open."""

    evaluation: str
    status: Literal["done", "cancelled"]


@dataclass(frozen=True)
class WaitingChanged(LocalMessage):
    """What an evaluation waits for before all of it can go on; empty when nothing is missing."""

    evaluation: str
    names: tuple[str, ...]


@dataclass(frozen=True)
class NodesChanged(LocalMessage):
    """The nodes of the deployment, present and lost, as they are now."""

    nodes: tuple[ServiceInfo, ...]
