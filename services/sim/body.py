"""A robot in its world behind its guard: nothing else moves it."""

from __future__ import annotations

import time

from common.clock import TICK_S
from common.errors import LegatoError
from common.robots.compile import read_ranges
from common.safety import Guard, SafetyLatch, Setpoint, read_limits
from services.sim.tool_log import ToolLog
from services.sim.world import World


class GuardedBody:
    """Steps a world; the guard says where its robot goes.

    Args:
        world: With the robot at rest.
        latch: The cell's faults.
        epoch: Of the episode, for the log.
        log: Takes the tool's pose after every tick.
    """

    def __init__(
        self, world: World, latch: SafetyLatch, *, epoch: int, log: ToolLog | None = None
    ) -> None:
        self.world = world
        limits = read_limits(world.robot, read_ranges(world.robot, world.model, prefix="robot_"))
        # It holds what it measures, not what it was built with.
        self.guard = Guard(limits, world.servos.positions(world.data), latch=latch)
        self._latch = latch
        self._epoch = epoch
        self._log = log
        self._tick = 0

    @property
    def fault(self) -> LegatoError | None:
        """Why the robot may not move, if there is a reason."""
        return self._latch.fault

    def command(self) -> Setpoint:
        """Let the guard decide the coming tick, and hand it to the servos."""
        setpoint = self.guard.step(self._tick * TICK_S)
        self.world.servos.command(setpoint.positions, setpoint.velocities)
        return setpoint

    def advance(self) -> None:
        """Step physics for one tick.

        Raises:
            FootholdOutOfReach: The body is where a foot cannot stand on its foothold.
        """
        self.world.advance(TICK_S)
        if self._log is not None:
            self._log.add(
                self.world,
                self.guard.status,
                t_mono_ns=time.monotonic_ns(),
                epoch=self._epoch,
                tick=self._tick,
            )
        self._tick += 1
