from __future__ import annotations

from typing import Annotated, ClassVar

from annotated_types import Ge, Len
from pydantic import Field

from common.messages.base import Joints, Message, Natural, PoseWire, Reply, Share

Samples = Annotated[list[Annotated[float, Ge(0)]], Len(1, 64)]
"""A measured quantity, one value per tick."""


class RobotState(Message):
    """Measured joint state of the robot in a cell, at the start of tick `header.step`."""

    positions: Joints
    """Joint positions in model order [rad, m]; a free hand: `[x, y, z, qw, qx, qy, qz]`."""
    velocities: Joints
    """Joint velocities in model order [rad/s, m/s]; a free hand: linear, then angular (body)."""
    due_frame_step: Annotated[int, Ge(-1)] = -1
    """Lockstep: the frame whose policy action takes effect at this tick, or -1."""


class RobotCommand(Reply):
    """Joint set-point to be reached at the end of tick `for_step`."""

    positions: Joints
    """Joint positions in model order [rad, m]."""
    velocities: Joints
    """Joint velocities over the tick [rad/s, m/s]."""


class RetargetStatus(Reply):
    """How well the robot followed the gripper reference over the ticks up to `for_step`.

    Sent with the last tick of every frame period, so that what is measured at 100 Hz costs one
    message at 10 Hz. Lists hold one value per tick, oldest first.
    """

    version: ClassVar[int] = 2

    T_world_reference: PoseWire
    """Interpolated gripper reference at the start of tick `for_step`."""
    T_world_tool: PoseWire
    """Measured tool pose at the start of tick `for_step`."""
    hand_error_m: Samples
    """Distance between reference and measured tool."""
    hand_error_rad: Samples
    """Angle between reference and measured tool."""
    solve_time_s: Samples
    """Time of the retargeting step."""
    hand_scaling: Annotated[list[Share], Len(1, 64)]
    """Share c_1 of the hand task that was achieved."""
    scaling: list[Share] = Field(max_length=8)
    """Smallest share c_i of each level that was achieved (paper, scaling factors)."""
    active_limits: list[str] = Field(max_length=64)
    """Joints whose velocity stood at a bound in any of the ticks."""
    limited_ticks: Natural
    """Ticks with an active limit."""
    solver_failures: Natural
    """Ticks of this episode in which a level fell back to its feasible default."""
