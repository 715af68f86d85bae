"""Between incoming commands and servos: what a robot is really told to do, tick by tick."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from common.clock import TICK_S
from common.errors import LegatoError, StaleCommand
from common.messages import SafetyStatus
from common.safety.latch import SafetyLatch
from common.safety.limits import RobotLimits
from common.safety.motion import MotionLaw, Setpoint, Violation

log = logging.getLogger(__name__)

COMMAND_AGE_LIMIT_S: Final = 0.05
"""When the newest command is older, the robot is braked."""
_ROUNDING_S: Final = 1e-6


@dataclass
class GuardCounts:
    """What a guard had to do; the fields of `SafetyCounts`."""

    coasted_ticks: int = 0
    position_clamps: int = 0
    velocity_clamps: int = 0
    acceleration_clamps: int = 0


class Guard:
    """Decides a robot's set-point for every tick. It begins at rest and stopped.

    Once started it follows commands that keep to the limits, to the bit, and brings others within
    them. Without a new command it goes on at the last velocity; when the newest one is too old, or
    is none at all, it latches a fault. Then, and when it is told to stop, it brakes as hard as the
    robot may and holds the pose in which it came to rest.

    Args:
        limits: Of the robot.
        positions: Where the robot is, at rest.
        latch: The cell's, shared with whoever else may stop it.
        age_limit_s: How old the newest command may be.
        dt_s: Length of a tick.
    """

    def __init__(
        self,
        limits: RobotLimits,
        positions: Sequence[float],
        *,
        latch: SafetyLatch,
        age_limit_s: float = COMMAND_AGE_LIMIT_S,
        dt_s: float = TICK_S,
    ) -> None:
        self.status: SafetyStatus = "stopped"
        self.counts = GuardCounts()
        self._law = MotionLaw(limits, dt_s=dt_s)
        self._latch = latch
        self._age_limit_s = age_limit_s
        self._now = Setpoint(list(positions), [0.0] * len(limits.axes))
        self._new: Setpoint | None = None
        self._made_s: float | None = None
        self._told = False

    @property
    def following(self) -> bool:
        """Whether it runs and was told where to go."""
        return self.status == "running" and self._made_s is not None

    def start(self) -> None:
        """Follow commands from now on.

        Raises:
            LegatoError: A fault is latched.
        """
        if self._latch.fault is not None:
            raise self._latch.fault.with_traceback(None)
        self.status = "running"

    def offer(self, command: Setpoint, *, made_s: float) -> None:
        """Take a command for the coming tick; one that is older than the last is no use.

        Args:
            command: To be reached at its end.
            made_s: Time of the state that it answers.
        """
        if self._made_s is None or made_s > self._made_s:
            self._new = command
            self._made_s = made_s

    def stop(self, fault: LegatoError | None = None) -> None:
        """Brake and hold.

        Args:
            fault: Latched until it is reset; without one a new start is enough.
        """
        if fault is not None:
            self._latch.engage(fault)
        if self.status == "running":
            self.status = "stopping"

    def step(self, now_s: float) -> Setpoint:
        """The set-point of the coming tick.

        Args:
            now_s: Time, of the same clock as `made_s`.
        """
        if self.status == "running" and self._made_s is not None:
            age_s = now_s - self._made_s
            if age_s > self._age_limit_s + _ROUNDING_S:
                self._fail(StaleCommand(age_s, self._age_limit_s))
            elif self._new is None:
                self._coast()
            else:
                command, self._new = self._new, None
                try:
                    return self._follow(command)
                except LegatoError as error:
                    self._fail(error)
        if self.status == "stopping":
            self._brake()
        return self._now

    def _follow(self, command: Setpoint) -> Setpoint:
        law = self._law
        law.check(command)
        if law.admits(self._now, command):
            self._now = command
        else:
            self._count(law.find_violation(self._now, command))
            self._now = law.approach(self._now, command)
        return self._now

    def _count(self, broken: Violation) -> None:
        self.counts.position_clamps += broken.position
        self.counts.velocity_clamps += broken.velocity
        self.counts.acceleration_clamps += broken.acceleration
        if (broken.position or broken.velocity) and not self._told:
            self._told = True
            log.warning("a command beyond the robot's limits was clamped; later ones are counted")

    def _coast(self) -> None:
        self.counts.coasted_ticks += 1
        self._now = self._law.advance(self._now, self._now.velocities)

    def _brake(self) -> None:
        self._now = self._law.brake(self._now)
        if not any(self._now.velocities):
            self.status = "stopped"

    def _fail(self, fault: LegatoError) -> None:
        log.error("the robot is stopped", extra=fault.describe())
        self.stop(fault)
