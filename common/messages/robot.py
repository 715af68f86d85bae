from __future__ import annotations

from typing import Annotated

from annotated_types import Ge, Le
from pydantic import Field

from common.messages.base import Joints, Message, PoseWire, Reply


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
    """How well the robot follows the gripper reference at tick `for_step`."""

    T_world_reference: PoseWire
    """Interpolated gripper reference at the start of the tick."""
    T_world_tool: PoseWire
    """Measured tool pose at the start of the tick."""
    hand_error_m: Annotated[float, Ge(0)]
    hand_error_rad: Annotated[float, Ge(0)]
    scaling: list[Annotated[float, Ge(0), Le(1)]] = Field(max_length=8)
    """Share c_i of each level that was achieved (paper, scaling factors)."""
    active_limits: list[str] = Field(max_length=64)
    """Joints whose velocity stands at a bound in this tick."""
    solve_time_s: Annotated[float, Ge(0)]
    solver_failures: Annotated[int, Ge(0)]
    """Ticks of this episode in which a level fell back to its feasible default."""
