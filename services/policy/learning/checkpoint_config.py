"""What a checkpoint says about itself to a machine: everything that deployment depends on."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from annotated_types import Ge, Gt, Le, Len
from pydantic import model_validator

from common.messages.base import Name
from services.policy.learning.config import Config, PolicyConfig
from services.policy.learning.images import CAMERA_PX

SCHEMA_VERSION = 1
ACTION_CONVENTION = "delta-setpoint-rotvec-v1"
"""Differential pose from one set-point to the next, in the frame of the first: translation [m],
rotation vector [rad]."""

Share = Annotated[float, Ge(0), Le(1)]


class ImageSpec(Config, frozen=True):
    """What the network is shown: both eyes of the camera, left first, gray."""

    camera_px: Literal[128] = CAMERA_PX
    """Side of the camera's image."""
    px: Literal[64, 128]
    """Side of the network's image; 64 is the 2x2 mean (`images.py`)."""
    eyes: Literal[2] = 2
    channels: Literal[1] = 1


class GraspHysteresis(Config, frozen=True):
    """From the probability of a closed gripper to closing it.

    Between the thresholds the gripper stays as it is, so that it does not flutter. They are equal
    by default: a gripper that is slow to open holds on to what it has placed.
    """

    close_above: Share = 0.5
    open_below: Share = 0.5

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.open_below > self.close_above:
            raise ValueError("open_below is above close_above")
        return self


class CheckpointConfig(Config, frozen=True):
    """The network and how it is to be used.

    A change of meaning raises `schema_version`; another convention of actions has another tag.
    """

    schema_version: Literal[1] = SCHEMA_VERSION
    action: Literal["delta-setpoint-rotvec-v1"] = ACTION_CONVENTION
    network: PolicyConfig
    image: ImageSpec
    rate_hz: Annotated[float, Gt(0)] = 10.0
    tasks: Annotated[tuple[Name, ...], Len(1, 64)]
    """What it was trained for."""
    seed: Annotated[int, Ge(0)]
    """Of the training run."""
    grasp: GraspHysteresis = GraspHysteresis()

    @model_validator(mode="after")
    def _one_size_of_image(self) -> Self:
        if self.image.px != self.network.encoder.input_px:
            raise ValueError(
                f"image.px is {self.image.px}, "
                f"the network's encoder takes {self.network.encoder.input_px}"
            )
        return self
