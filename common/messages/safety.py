"""Stopping a cell's robot from outside, and what its guard says about itself."""

from __future__ import annotations

from typing import Annotated, Literal

from annotated_types import Len
from pydantic import BaseModel

from common.messages.base import MODEL_CONFIG, Message, Name, Natural
from common.messages.episode import Problem

SafetyStatus = Literal["stopped", "running", "stopping"]
"""What a robot does: holds its pose, follows commands, or brakes."""

StopReason = Annotated[str, Len(0, 200)]


class SafetyCounts(BaseModel):
    """What a guard kept from its robot, since the cell was configured."""

    model_config = MODEL_CONFIG

    foreign_messages: Natural = 0
    """Messages of a node that is not the cell's writer."""
    coasted_ticks: Natural = 0
    """Real time: ticks without a new command that went on at the last velocity."""
    position_clamps: Natural = 0
    """Ticks whose command left a joint's range."""
    velocity_clamps: Natural = 0
    """Ticks whose command was faster than a limit."""
    acceleration_clamps: Natural = 0
    """Ticks whose command could not be reached within the acceleration limits."""


class SafetyStop(Message):
    """Emergency stop: brake now, hold, and stay so until `SafetyReset`. Of any epoch."""

    by: Name
    """Who stops: `rest`, `viewer`, `button`."""
    reason: StopReason = ""


class SafetyReset(Message):
    """Release a latched fault or emergency stop of a robot that is at rest. Of any epoch."""

    by: Name


class SafetyState(Message):
    """State of a cell's guard. Sent when it changes, and once a second."""

    status: SafetyStatus
    fault: Problem | None = None
    """Why it may not move; latched until `SafetyReset`, or the next episode if it may."""
    emergency_stop: bool = False
    """Whether the fault is an emergency stop, which no episode releases."""
    counts: SafetyCounts = SafetyCounts()
