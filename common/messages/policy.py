from __future__ import annotations

from typing import Annotated

from annotated_types import Ge, Len
from pydantic import BaseModel

from common.messages.base import MODEL_CONFIG, Message, PoseWire, Reply, Vector3


class ActionStep(BaseModel):
    """One 10 Hz step from the gripper's set-point to the next, in the frame of the first."""

    model_config = MODEL_CONFIG

    translation_m: Vector3
    rotation_rad: Vector3
    """Rotation vector."""
    grasp: bool
    """True = close."""


class PolicyAction(Reply):
    """What the policy wants next, computed from the frame of tick `for_step`."""

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
