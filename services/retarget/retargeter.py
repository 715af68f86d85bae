"""What a retargeter is, and the one of a hand without a body."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from common.se3 import Array, pose_from_wire, pose_to_wire
from services.retarget.reference import TickReference


class Motion(NamedTuple):
    """What a robot is told to do in one tick.

    Args:
        positions: To be reached at the end of the tick, as in `RobotCommand`.
        velocities: Over the tick.
        scaling: Share of each level that was achieved.
        active_limits: Joints whose velocity stands at a bound, walls and pairs that hold back.
        failures: Levels that fell back to their feasible default.
    """

    positions: list[float]
    velocities: list[float]
    scaling: list[float]
    active_limits: list[str]
    failures: int


class Retargeter(Protocol):
    """Follows a gripper reference with one robot. Integrates its own command, tick by tick."""

    def compute_tool_pose(self, positions: Sequence[float]) -> Array:
        """T_world_tool (4, 4) at measured positions."""
        ...

    def start(self, positions: Sequence[float]) -> None:
        """Begin an episode at the measured positions, at rest."""
        ...

    @property
    def T_world_hand(self) -> Array:
        """(4, 4) tool pose that is commanded at this moment."""
        ...

    def follow(self, reference: TickReference, measured: Sequence[float] | None = None) -> Motion:
        """Plan one tick; `measured` are the positions of the state it answers."""
        ...

    def brake(self, ticks: int) -> Motion:
        """Some ticks of coming to rest, or of resting, as hard as the robot may be stopped."""
        ...


class IdentityRetargeter:
    """A free hand is where the reference is."""

    def compute_tool_pose(self, positions: Sequence[float]) -> Array:
        """T_world_tool (4, 4) of `[x, y, z, qw, qx, qy, qz]`."""
        return pose_from_wire(positions)

    def __init__(self) -> None:
        self._T_world_hand: Array = np.eye(4)

    @property
    def T_world_hand(self) -> Array:
        """(4, 4) tool pose that is commanded at this moment."""
        return self._T_world_hand

    def start(self, positions: Sequence[float]) -> None:
        """Stand at the measured pose."""
        self._T_world_hand = self.compute_tool_pose(positions)

    def follow(self, reference: TickReference, measured: Sequence[float] | None = None) -> Motion:
        """Pose at the end of the tick; linear velocity in world axes, angular in the hand's."""
        T = self._T_world_hand = reference.T_world_end
        # The turn's axis is fixed in the world and therefore in the hand as well.
        angular = T[:3, :3].T @ reference.twist[3:]
        return Motion(
            positions=pose_to_wire(T),
            velocities=[*reference.twist[:3].tolist(), *angular.tolist()],
            scaling=[1.0],
            active_limits=[],
            failures=0,
        )

    def brake(self, ticks: int) -> Motion:
        """Stay: there is no mass to be stopped."""
        del ticks
        return Motion(
            positions=pose_to_wire(self._T_world_hand),
            velocities=[0.0] * 6,
            scaling=[0.0],
            active_limits=[],
            failures=0,
        )
