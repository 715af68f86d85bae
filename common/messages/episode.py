from __future__ import annotations

from typing import Annotated, ClassVar, Final, Literal, Self

from annotated_types import Ge, Gt, Le, Len
from pydantic import BaseModel, Field, model_validator

from common.messages.base import MODEL_CONFIG, Message, Mode, Name, Natural, Share

Outcome = Literal["success", "failure", "aborted"]


class Problem(BaseModel):
    """An error as it travels: the same parts as in `LegatoError`."""

    model_config = MODEL_CONFIG

    code: str
    happened: str
    expected: str
    action: str


class EpisodeConfigure(Message):
    """Prepare this episode. Every node named in `nodes` answers with `EpisodeReady`."""

    version: ClassVar[int] = 2

    task: Name
    robot: Name
    policy: Name
    seed: Natural
    mode: Mode
    nodes: dict[str, Name]
    """Kind of service -> the node that takes part: sim, retarget, gripper, policy."""
    camera: Name = "t265"
    action_latency_s: Annotated[float, Ge(0), Le(1)] = 0.0
    """Lockstep: time from a frame to the moment its action takes effect."""
    tracking_lag_s: Annotated[float, Ge(0), Le(1)] = 0.0
    """Time constant with which the hand lags behind its reference, on purpose."""
    node_deadline_s: Annotated[float, Gt(0), Le(600)] = 1.6
    """Wall time after which a silent node aborts the episode."""
    randomise_camera: bool = False
    """Vary exposure, vignette and noise of the images, by the seed."""
    full_grid: bool = False
    """Trace every pixel instead of interpolating even regions."""
    pictures: bool = False
    """Send `EpisodePicture`s of the key moments after the episode."""


class EpisodeReady(Message):
    """A node has done what `EpisodeConfigure` asked for, or says why it cannot."""

    node: Name
    kind: Name
    problem: Problem | None = None


class EpisodeStart(Message):
    """All nodes are ready: the owner of the cell starts the clock."""


class EpisodeAbort(Message):
    """Stop this episode now. It will have no result."""

    reason: str


class EpisodeEvent(Message):
    """Something worth showing happened in an episode."""

    event: Literal["started", "succeeded", "failed", "aborted"]
    detail: str = ""


class EpisodePicture(Message):
    """An image of a key moment, for reports. Sent after the episode, so it costs it nothing."""

    moment: Name
    """What the picture shows: start, grasp, release, end."""
    view: Literal["scene", "left", "right"]
    width: Annotated[int, Ge(1), Le(2048)]
    height: Annotated[int, Ge(1), Le(2048)]
    channels: Literal[1, 3]
    pixels: bytes
    """height × width × channels bytes, rows top-down."""

    @model_validator(mode="after")
    def _exact_length(self) -> Self:
        expected = self.width * self.height * self.channels
        if len(self.pixels) != expected:
            raise ValueError(f"image has {len(self.pixels)} bytes, expected {expected}")
        return self


class Distribution(BaseModel):
    """Median, high percentiles and largest value of something measured every tick."""

    model_config = MODEL_CONFIG

    median: float
    p95: float
    p99: float
    largest: float


class StagesReached(BaseModel):
    """How far an episode came at its best; a stage that was reached stays reached."""

    model_config = MODEL_CONFIG

    grasped: bool
    """The moved object was touched while the grasp was closed, for 0.2 s."""
    lifted: bool
    """Grasped as above, and at least 20 mm above where it started."""
    placed: bool
    """At one tick the objects were as the success test wants them, whatever the hand did."""
    released: bool
    """All of the success test held at one tick; success takes 0.5 s of it."""

    @property
    def names(self) -> list[str]:
        """Those that were reached, in order."""
        return [name for name in STAGES if getattr(self, name)]


STAGES: Final = tuple(StagesReached.model_fields)


class WallTimes(BaseModel):
    """Where the wall time of the cell's owner went over the episode [s]."""

    model_config = MODEL_CONFIG

    physics_s: float
    camera_s: float
    waiting_s: float
    """Waiting for retargeter, gripper and policy, including the bus."""
    solve_s: float
    """Part of `waiting_s`: time inside the retargeter's solver."""
    inference_s: float
    """Part of `waiting_s`: time inside the policy."""


class TrialResult(BaseModel):
    """How an episode ended and what was measured; the same in messages, REST and reports."""

    model_config = MODEL_CONFIG

    outcome: Outcome
    reason: str
    """Why: the task's own words for success and failure, the cause for aborted."""
    failed_conditions: list[str] = Field(max_length=32)
    ticks: Natural
    sim_time_s: Annotated[float, Ge(0)]
    wall_time_s: Annotated[float, Ge(0)]
    stages: StagesReached
    goal_distance_m: Annotated[float, Ge(0)]
    """Smallest distance between the moved object and its goal over the episode."""
    hand_error_m: Distribution
    hand_error_rad: Distribution
    hand_scaling_mean: Share
    """Share c_1 of the hand task that the retargeter achieved, mean over the ticks."""
    hand_scaling_least: Share
    """The smallest c_1 of any tick."""
    limited_share: Share
    """Share of ticks in which a limit of the robot was active."""
    solver_failures: Natural
    """Ticks in which the retargeter fell back to a feasible default."""
    solve_time_s: Distribution
    inference_s: Distribution
    wall_times: WallTimes
    held_ticks: Natural
    """Real time: ticks before the first joint command, in which the robot held its pose."""
    missed_frames: Natural
    """Real time: frames whose action had not arrived when the next one was due."""
    resends: Natural
    """Lockstep: ticks that had to be sent again."""
    trace_sha256: Annotated[str, Len(64, 64)]


class EpisodeResult(Message):
    """How an episode ended. The owner of the cell sends exactly one per epoch."""

    version: ClassVar[int] = 3

    result: TrialResult
