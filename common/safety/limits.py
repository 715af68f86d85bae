"""What a robot may be told to do: ranges, speeds and accelerations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from common.errors import WrongShape
from common.robots import HandServo, RobotSpec


@dataclass(frozen=True)
class AxisLimits:
    """Limits of one degree of freedom.

    Args:
        lower: Least position [rad, m]; infinite where there is none.
        upper: Greatest position.
        velocity: Largest speed [rad/s, m/s].
        acceleration: Largest acceleration that a command may ask for [rad/s2, m/s2].
        stop_acceleration: How hard it is braked when it is stopped [rad/s2, m/s2].
    """

    lower: float
    upper: float
    velocity: float
    acceleration: float
    stop_acceleration: float


@dataclass(frozen=True)
class RobotLimits:
    """Limits of a robot.

    Args:
        axes: One per degree of freedom, in the order of `RobotState.velocities`.
        free_hand: Positions are a pose `[x, y, z, qw, qx, qy, qz]`, velocities a twist.
    """

    axes: tuple[AxisLimits, ...]
    free_hand: bool


def read_limits(spec: RobotSpec, ranges: Sequence[tuple[float, float]]) -> RobotLimits:
    """Limits of a robot from robot.toml, and its joints' ranges from its model.

    Args:
        spec: The robot.
        ranges: Lower and upper end per joint [rad, m]; none for a free hand.

    Raises:
        WrongShape: Not one range per joint.
    """
    if len(ranges) != len(spec.joints):
        raise WrongShape("joint ranges", len(spec.joints), len(ranges))
    if spec.hand is not None:
        return RobotLimits(_read_hand(spec.hand), free_hand=True)
    axes = tuple(
        AxisLimits(
            lower,
            upper,
            joint.velocity_limit,
            joint.acceleration_limit,
            joint.stop_acceleration or joint.acceleration_limit,
        )
        for joint, (lower, upper) in zip(spec.joints, ranges, strict=True)
    )
    return RobotLimits(axes, free_hand=False)


def _read_hand(hand: HandServo) -> tuple[AxisLimits, ...]:
    shift = AxisLimits(
        -math.inf,
        math.inf,
        hand.speed_limit_m_s,
        hand.acceleration_limit_m_s2,
        hand.stop_acceleration_m_s2,
    )
    turn = AxisLimits(
        -math.inf,
        math.inf,
        hand.turn_limit_rad_s,
        hand.acceleration_limit_rad_s2,
        hand.stop_acceleration_rad_s2,
    )
    return (shift,) * 3 + (turn,) * 3
