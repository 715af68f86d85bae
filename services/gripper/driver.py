"""The driver's logic for one gripper: ramp, current cap, grip detection. No bus, no clock."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from common.calibration.four_bar import CLOSED_RAD, OPEN_RAD, opening_m
from common.clock import TICK_S
from services.gripper.motors import MotorBackend, MotorGoal


@dataclass(frozen=True)
class DriverConfig:
    """How the fingers move.

    Args:
        ramp_rad_s: Speed of the set-point; the full stroke takes 0.785 s.
        current_limit_a: Cap of each motor; with 1.78 N m/A this is the grip force.
        still_rad_s: Slower than this counts as at rest.
    """

    ramp_rad_s: float = 1.0
    current_limit_a: float = 0.6
    still_rad_s: float = 0.05


class DriverReport(NamedTuple):
    """The gripper as a tool."""

    opening_m: float
    moving: bool
    gripped: bool


class Driver:
    """Moves one gripper's fingers between open and closed.

    Args:
        motors: Simulated or real.
        config: Speeds and limits.
    """

    def __init__(self, motors: MotorBackend, config: DriverConfig) -> None:
        self._motors = motors
        self._config = config
        self._setpoint_rad: float | None = None
        self.grasp = False

    def step(self) -> DriverReport:
        """One 10 ms step: move the set-point along its ramp, write it, judge the reading."""
        reading = self._motors.read()
        if reading is None:
            raise RuntimeError("the motors have not been read yet")
        present_rad = 0.5 * sum(reading.positions_rad)
        if self._setpoint_rad is None:
            self._setpoint_rad = present_rad
        goal_rad = CLOSED_RAD if self.grasp else OPEN_RAD
        reach = self._config.ramp_rad_s * TICK_S
        self._setpoint_rad += max(-reach, min(reach, goal_rad - self._setpoint_rad))
        self._motors.write(
            MotorGoal((self._setpoint_rad, self._setpoint_rad), self._config.current_limit_a)
        )
        still = all(abs(v) < self._config.still_rad_s for v in reading.velocities_rad_s)
        at_cap = min(abs(i) for i in reading.currents_a) >= 0.9 * self._config.current_limit_a
        return DriverReport(
            opening_m=max(0.0, opening_m(present_rad)),
            moving=not still,
            gripped=self.grasp and still and at_cap,
        )
