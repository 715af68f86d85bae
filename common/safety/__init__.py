"""What keeps a robot from harm, between incoming commands and its servos (docs/safety.md).

No bus and no clock of its own: messages and time are handed in, so that the simulation and a
driver of real hardware use the same code.
"""

from __future__ import annotations

from common.safety.foreign import ForeignCounts
from common.safety.guard import COMMAND_AGE_LIMIT_S, Guard, GuardCounts
from common.safety.latch import SafetyLatch
from common.safety.limits import RobotLimits, read_limits
from common.safety.motion import MotionLaw, Setpoint
from common.safety.writer import SingleWriter

__all__ = [
    "COMMAND_AGE_LIMIT_S",
    "ForeignCounts",
    "Guard",
    "GuardCounts",
    "MotionLaw",
    "RobotLimits",
    "SafetyLatch",
    "Setpoint",
    "SingleWriter",
    "read_limits",
]
