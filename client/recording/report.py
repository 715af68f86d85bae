"""What a worker says about a trial: one line of JSON."""

from __future__ import annotations

from typing import Annotated, Literal

from annotated_types import Ge
from pydantic import BaseModel, ConfigDict

from client.recording.variation import Variation
from common.messages.base import Natural

_CONFIG = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class TrialReport(BaseModel):
    """How a trial ended.

    An aborted one is never stored: it says nothing about the demonstrator.
    """

    model_config = _CONFIG

    trial: Natural
    seed: Natural
    outcome: Literal["success", "failure", "aborted"]
    reason: str
    sim_time_s: Annotated[float, Ge(0)] = 0.0
    stored: bool = False
    """Whether its episode lies in the folder of parts."""


class WorkerOrder(BaseModel):
    """What a worker is started with."""

    model_config = _CONFIG

    task: str
    robot: str
    camera: str
    policy: str
    seed: Natural
    keep_failed: bool
    variation: Variation = Variation()
    parts: str
    """Folder for finished episodes."""
