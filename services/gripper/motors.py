"""What a pair of finger motors must offer, whatever they are made of."""

from __future__ import annotations

from typing import NamedTuple, Protocol


class MotorReading(NamedTuple):
    """Present values of left and right motor; positive opens, on both sides."""

    positions_rad: tuple[float, float]
    velocities_rad_s: tuple[float, float]
    currents_a: tuple[float, float]


class MotorGoal(NamedTuple):
    """Goal of both motors under a cap of their current (current-based position control)."""

    positions_rad: tuple[float, float]
    current_limit_a: float


class MotorBackend(Protocol):
    """Two motors. `read` and `write` are one bus transaction each and may block."""

    def read(self) -> MotorReading | None:
        """Newest reading, or None before the first."""
        ...

    def write(self, goal: MotorGoal) -> None:
        """Set the goals."""
        ...


class SimulatedMotors:
    """Motors that live in the simulation: readings come and goals leave as messages."""

    def __init__(self) -> None:
        self._reading: MotorReading | None = None
        self.goal: MotorGoal | None = None

    def receive(self, reading: MotorReading) -> None:
        """Take the reading that the simulation sent."""
        self._reading = reading

    def read(self) -> MotorReading | None:
        """The last reading received."""
        return self._reading

    def write(self, goal: MotorGoal) -> None:
        """Keep the goal, to be sent to the simulation."""
        self.goal = goal
