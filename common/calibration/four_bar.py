"""Geometry of the gripper's parallelogram fingers: driver angle, opening, pad position, force."""

from __future__ import annotations

import math
from pathlib import Path

GRIPPER_MODEL = Path(__file__).with_name("gripper.xml")
"""The gripper's MJCF; its root body is the tool frame."""

LINK_LENGTH_M = 0.08
CLOSED_OVERLAP_M = 0.0095
"""How far past contact the pads would be at angle 0; closing to 0 is what squeezes."""
OPEN_RAD = math.pi / 4
"""Driver angle of the command "open"."""
CLOSED_RAD = 0.0
"""Driver angle of the command "close"."""
PADS_TOUCH_RAD = math.asin(CLOSED_OVERLAP_M / (2 * LINK_LENGTH_M))
_PAD_CENTRE_X_M = 0.20325

MOTOR_TORQUE_NM_PER_A = 1.78
"""Dynamixel XM430-W350: 4.1 N m at 2.3 A (maker's data sheet)."""


def opening_m(driver_rad: float) -> float:
    """Distance between the pads: w = 2 l sin(phi) - 9.5 mm; below zero they press together.

    Args:
        driver_rad: Driver angle phi of a symmetric gripper [rad].
    """
    return 2.0 * LINK_LENGTH_M * math.sin(driver_rad) - CLOSED_OVERLAP_M


def driver_rad(opening: float) -> float:
    """Driver angle for an opening, the inverse of `opening_m`.

    Args:
        opening: Distance between the pads [m], at most 150.5 mm.
    """
    return math.asin(min(1.0, (opening + CLOSED_OVERLAP_M) / (2.0 * LINK_LENGTH_M)))


def pad_centre_x_m(driver: float) -> float:
    """Distance of the pad centres ahead of the tool frame along +x; 23 mm less when open.

    Args:
        driver: Driver angle [rad].
    """
    return _PAD_CENTRE_X_M + LINK_LENGTH_M * math.cos(driver)


def pad_force_n(current_a: float, driver: float) -> float:
    """Force of one pad: F = k I / (l cos phi), an upper bound without friction.

    Args:
        current_a: Motor current [A].
        driver: Driver angle [rad].
    """
    return MOTOR_TORQUE_NM_PER_A * current_a / (LINK_LENGTH_M * math.cos(driver))
