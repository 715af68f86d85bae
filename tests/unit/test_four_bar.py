from __future__ import annotations

import math

import pytest

from common.calibration.four_bar import (
    OPEN_RAD,
    PADS_TOUCH_RAD,
    driver_rad,
    opening_m,
    pad_centre_x_m,
    pad_force_n,
)


@pytest.mark.parametrize(
    ("angle_rad", "opening_mm", "pad_x_m"),
    [
        (0.0, -9.5, 0.28325),
        (0.2, 22.2871, 0.28166),
        (0.5, 67.2081, 0.27346),
        (OPEN_RAD, 103.6371, 0.25982),
        (math.pi / 2, 150.5, 0.20325),
    ],
)
def test_published_table(angle_rad: float, opening_mm: float, pad_x_m: float):
    assert opening_m(angle_rad) * 1e3 == pytest.approx(opening_mm, abs=1e-3)
    assert pad_centre_x_m(angle_rad) == pytest.approx(pad_x_m, abs=1e-5)


@pytest.mark.parametrize("angle_rad", [0.0, 0.1, 0.7, 1.5])
def test_driver_angle_inverts_the_opening(angle_rad: float):
    assert driver_rad(opening_m(angle_rad)) == pytest.approx(angle_rad)


def test_pads_touch_where_the_opening_is_zero():
    assert opening_m(PADS_TOUCH_RAD) == pytest.approx(0.0, abs=1e-12)


def test_force_is_torque_over_lever():
    assert pad_force_n(0.32, 0.0) == pytest.approx(7.12, abs=0.01)
