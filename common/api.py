"""The REST resources under `/api/v1`: one definition for the control plane, the client and docs."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any, Literal, Self

from annotated_types import Ge, Le, Len
from pydantic import BaseModel, ConfigDict, Field, StrictInt, model_validator

from common.messages import (
    CheckpointDescription,
    Mode,
    Problem,
    SafetyCounts,
    SafetyStatus,
    StagesReached,
    TrialResult,
)
from common.messages.base import Name
from common.messages.checkpoint import FolderPath
from common.messages.safety import StopReason

PREFIX = "/api/v1"

_CONFIG = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

Names = Annotated[list[Name], Len(1, 64)]
EvaluationStatus = Literal["running", "done", "cancelled"]
TrialStatus = Literal["pending", "running", "success", "failure", "aborted", "cancelled"]


class EvaluationRequest(BaseModel):
    """A grid tasks × robots × policies × trials. Trial i of a task has one seed for all of them."""

    model_config = _CONFIG

    tasks: Names
    robots: Names
    policy: Name | None = None
    """One policy; the same as `policies` with one entry."""
    policies: Names | None = None
    trials: Annotated[StrictInt, Ge(1), Le(100_000)] = 5
    seed: Annotated[StrictInt, Ge(0), Le(2**53 - 1)] = 0
    mode: Mode = "lockstep"
    camera: Name = "t265"
    full_grid: bool = False
    """Trace every pixel of the stereo images: slower, exact."""
    action_latency_s: Annotated[float, Ge(0), Le(1)] = 0.0
    """Lockstep: modelled time from a frame to the moment its action takes effect [s]."""
    tracking_lag_s: Annotated[float, Ge(0), Le(1)] = 0.0
    """Time constant with which every robot's hand lags behind its reference, on purpose [s]."""
    randomise_camera: bool = False
    """Vary exposure, vignette and noise of the stereo images, by the trial's seed."""
    pictures: bool = True
    """Keep pictures of each trial's key moments."""

    @model_validator(mode="after")
    def _one_way_to_name_policies(self) -> Self:
        if (self.policy is None) == (self.policies is None):
            raise ValueError("give either policy or policies")
        for field in ("tasks", "robots", "policies"):
            names = getattr(self, field)
            if names is not None and len(set(names)) != len(names):
                raise ValueError(f"{field} names something twice")
        return self

    @property
    def policy_names(self) -> list[str]:
        """The policies of the grid, however they were given."""
        return list(self.policies) if self.policies is not None else [str(self.policy)]


class StageCounts(BaseModel):
    """How many trials reached each stage; `StagesReached` says what the stages mean."""

    model_config = _CONFIG

    grasped: int
    lifted: int
    placed: int
    released: int


class CellSummary(BaseModel):
    """One task × robot × policy of the grid, over the trials that have ended so far.

    `success_rate` = successes / (successes + failures + aborted): what could not be run to its end
    is not taken out of the count. Hand errors are medians over trials of each trial's median and
    95th percentile, solve times of its median and 99th percentile. The share c_1 of the hand task
    is the mean and the least over all trials, the share of ticks with an active limit the mean;
    fallbacks of the solver are summed. The real-time factor is simulated over wall time, summed
    over trials.
    """

    model_config = _CONFIG

    task: str
    robot: str
    policy: str
    trials: int
    """Trials asked for."""
    done: int
    successes: int
    failures: int
    aborted: int
    success_rate: float | None
    interval95: tuple[float, float]
    """Wilson interval of the success rate."""
    stages: StageCounts
    """Over the trials with a result."""
    median_hand_error_m: float | None
    p95_hand_error_m: float | None
    mean_hand_scaling: float | None
    least_hand_scaling: float | None
    limited_share: float | None
    solver_failures: int
    median_solve_time_s: float | None
    p99_solve_time_s: float | None
    real_time_factor: float | None
    trace_sha256: list[str | None]
    """One hash per trial, in order; null where a trial has no trace (pending, aborted)."""


class Evaluation(BaseModel):
    """An evaluation: what was asked, how far it is, what came out."""

    model_config = _CONFIG

    id: str
    status: EvaluationStatus
    request: EvaluationRequest
    created_at: datetime
    finished_at: datetime | None
    trials_total: int
    trials_done: int
    waiting_for: list[str]
    """Nodes or kinds that must come (back) before it can go on."""
    cells: list[CellSummary]
    versions: dict[str, str]
    """Code and the packages that shape results."""


class Attempt(BaseModel):
    """One try at a trial. A trial whose first attempt was aborted is tried once more."""

    model_config = _CONFIG

    number: int
    epoch: int
    cell: str
    outcome: Literal["running", "success", "failure", "aborted", "cancelled"]
    reason: str
    started_at: datetime
    finished_at: datetime | None


class Trial(BaseModel):
    """One trial: a pure function of task, robot, policy, seed, mode and versions."""

    model_config = _CONFIG

    id: int
    evaluation: str
    index: int
    task: str
    robot: str
    policy: str
    seed: int
    status: TrialStatus
    reason: str
    attempts: list[Attempt]
    result: TrialResult | None
    pictures: list[str]
    """Names; fetch them under `/evaluations/{id}/trials/{trial}/pictures/{name}`."""

    @property
    def ended(self) -> bool:
        """Whether it has run to an end, its own or an abort."""
        return self.status in ("success", "failure", "aborted")

    @property
    def stages(self) -> StagesReached | None:
        """How far it came, once there is a result."""
        return None if self.result is None else self.result.stages


class ProgressEvent(BaseModel):
    """What server-sent events carry: the evaluation now, and the trial that changed it."""

    model_config = _CONFIG

    evaluation: Evaluation
    trial: Trial | None = None


class RobotInfo(BaseModel):
    """A robot this code knows."""

    model_config = _CONFIG

    name: str
    title: str
    degrees_of_freedom: int
    available: bool
    """A retargeter for it is running."""


class TaskInfo(BaseModel):
    """A task this code knows."""

    model_config = _CONFIG

    name: str
    title: str
    time_limit_s: float


class PolicyInfo(BaseModel):
    """A policy that a running policy service offers."""

    model_config = _CONFIG

    name: str
    nodes: list[str]
    checkpoints: dict[str, CheckpointDescription] = Field(
        default_factory=dict[str, CheckpointDescription]
    )
    """What a learned policy is, per node; empty for one that comes with the code."""


class PolicyLoadRequest(BaseModel):
    """Load a checkpoint under the name of the path, in place of one that has it."""

    model_config = _CONFIG

    folder: FolderPath
    """On the host of the policy service; a relative one is below its `--checkpoints`."""
    node: Name | None = None
    """Policy service; without it all that run."""


class ServiceInfo(BaseModel):
    """A node as the bus shows it."""

    model_config = _CONFIG

    kind: str
    node: str
    alive: bool
    code_version: str | None
    packages: dict[str, str]
    host: str | None
    pid: int | None
    offers: dict[str, list[str]]
    checkpoints: dict[str, CheckpointDescription] = Field(
        default_factory=dict[str, CheckpointDescription]
    )
    metrics: dict[str, float]


class CellInfo(BaseModel):
    """A cell and what its guard says (docs/safety.md)."""

    model_config = _CONFIG

    cell: str
    alive: bool
    """Its owner is on the bus."""
    status: SafetyStatus | None
    """What its robot does; null when nothing was heard since its owner came."""
    fault: Problem | None
    """Why it may not move."""
    emergency_stop: bool
    counts: SafetyCounts | None
    """What the guard kept from the robot."""


class StopRequest(BaseModel):
    """Emergency stop of cells."""

    model_config = _CONFIG

    cells: Names | None = None
    """Without it all."""
    reason: StopReason = ""
    """Shown with the aborted trials."""


class ResetRequest(BaseModel):
    """Release of what is latched in cells."""

    model_config = _CONFIG

    cells: Names | None = None
    """Without it all."""


class ProblemDetails(BaseModel):
    """RFC 9457 `application/problem+json`, with the error's own code and advice."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    type: str
    title: str
    status: int
    detail: str
    code: str
    expected: str
    action: str
    errors: list[dict[str, Any]] = Field(default_factory=list[dict[str, Any]])
    """For a body that does not validate: each field, what it is and what it should be."""
