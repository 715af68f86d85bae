from __future__ import annotations

from typing import Annotated

from annotated_types import Ge, Len

from common.messages.base import Message, Reply

MotorPair = Annotated[list[float], Len(2, 2)]
"""Left and right motor; positive opens, on both sides."""


class MotorState(Message):
    """What the gripper's two motors measure, at the start of tick `header.step`."""

    positions_rad: MotorPair
    velocities_rad_s: MotorPair
    currents_a: MotorPair
    due_frame_step: Annotated[int, Ge(-1)] = -1
    """Lockstep: the frame whose policy action takes effect at this tick, or -1."""


class MotorCommand(Reply):
    """Goal of the two motors for tick `for_step` (current-based position control)."""

    positions_rad: MotorPair
    current_limit_a: Annotated[float, Ge(0)]


class GripperState(Reply):
    """The gripper as a tool: how far open, what it was told, whether it holds something."""

    opening_m: Annotated[float, Ge(0)]
    grasp: bool
    """The command in force: True = close."""
    moving: bool
    gripped: bool
    """Closed against an object: at rest, at the current limit, away from the goal."""
