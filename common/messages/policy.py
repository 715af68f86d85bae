from __future__ import annotations

import math
from typing import Annotated, ClassVar

from annotated_types import Ge, Len
from pydantic import AfterValidator, BaseModel

from common.messages.base import MODEL_CONFIG, Message, PoseWire, Reply, Vector3

LARGEST_STEP_M = 1.0
LARGEST_STEP_RAD = math.pi + 1e-6
"""A rotation vector is no longer, but for rounding."""


def _no_longer_than(limit: float) -> AfterValidator:
    def check(vector: list[float]) -> list[float]:
        length = math.hypot(*vector)
        if length > limit:
            raise ValueError(f"has length {length:.3g}, expected at most {limit:.3g}")
        return vector

    return AfterValidator(check)


class Motion(BaseModel):
    """A motion of the gripper in the frame where it begins."""

    model_config = MODEL_CONFIG

    translation_m: Vector3
    rotation_rad: Vector3
    """Rotation vector."""


class ActionStep(BaseModel):
    """One 10 Hz step from the gripper's set-point to the next, in the frame of the first.

    At most 1 m and half a turn: a longer step is not a motion, and no robot is to start on it.
    """

    model_config = MODEL_CONFIG

    translation_m: Annotated[Vector3, _no_longer_than(LARGEST_STEP_M)]
    rotation_rad: Annotated[Vector3, _no_longer_than(LARGEST_STEP_RAD)]
    """Rotation vector."""
    grasp: bool
    """True = close."""
    meant: Motion | None = None
    """What a demonstrator that disturbs itself meant to do instead: what is to be learned. No
    robot ever executes it."""


class PolicyAction(Reply):
    """What the policy wants next, computed from the frame of tick `for_step`."""

    version: ClassVar[int] = 2

    steps: Annotated[list[ActionStep], Len(1, 64)]
    """One step, or a chunk of consecutive ones."""
    inference_s: Annotated[float, Ge(0)]


class GroundTruth(Message):
    """Poses of the scene's objects, for scripted experts and viewers; learned policies get none."""

    T_world_tool: PoseWire
    objects: dict[str, PoseWire]
    """Name of the object -> T_world_object."""
    opening_m: float
    """Distance between the finger pads; below zero they are pressed together."""
