"""Pixel to ray and back; what a calibration file may say."""

from __future__ import annotations

import math
import tomllib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.calibration import (
    R_TOOL_CAMERA,
    StereoCalibration,
    list_calibrations,
    load_calibration,
)
from common.calibration.loader import CALIBRATION_FOLDER
from common.errors import BadCalibration, UnknownName

NAMES = ("pinhole", "t265")
CALIBRATIONS = {name: load_calibration(name) for name in NAMES}

pixels = st.floats(0.0, 128.0)
names = st.sampled_from(NAMES)


@given(name=names, column=pixels, row=pixels)
def test_projecting_a_ray_returns_to_its_pixel(name: str, column: float, row: float):
    calibration = CALIBRATIONS[name]
    if math.hypot(column - 64.0, row - 64.0) > calibration.lens.circle_px():
        return
    direction = calibration.ray_directions(np.array(column), np.array(row))
    assert np.linalg.norm(direction) == pytest.approx(1.0, abs=1e-12)
    assert calibration.project(direction) == pytest.approx([column, row], abs=1e-9)


@given(
    name=names,
    theta=st.floats(0.0, math.radians(59.0)),
    phi=st.floats(-math.pi, math.pi),
    length=st.floats(1e-3, 1e3),
)
def test_the_ray_of_a_projection_is_the_direction(
    name: str, theta: float, phi: float, length: float
):
    direction = np.array(
        [math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)]
    )
    column, row = CALIBRATIONS[name].project(length * direction)
    found = CALIBRATIONS[name].ray_directions(np.array(column), np.array(row))
    assert found == pytest.approx(direction, abs=1e-12)


@given(theta=st.floats(0.0, math.radians(81.5)))
def test_kannala_brandt_follows_its_polynomial(theta: float):
    k = (-0.008, 0.043, -0.040, 0.007)
    radius = 45.8 * (theta + sum(c * theta ** (3 + 2 * i) for i, c in enumerate(k)))
    column, _ = CALIBRATIONS["t265"].project(np.array([math.sin(theta), 0.0, math.cos(theta)]))
    assert column == pytest.approx(64.0 + radius, abs=1e-10)


def test_pinhole_sees_its_field_of_view_from_edge_to_edge():
    top = CALIBRATIONS["pinhole"].ray_directions(np.array(64.0), np.array(0.0))
    assert math.degrees(math.atan2(-top[1], top[2])) == pytest.approx(60.0)


def test_camera_axes_are_right_down_forward():
    rays = CALIBRATIONS["t265"].pixel_directions()
    assert rays.shape == (128, 128, 3)
    assert rays[64, 127, 0] > 0.9
    assert rays[127, 64, 1] > 0.9
    assert rays[63, 63, 2] > 0.999
    # Right in the picture is tool -y, down is tool -z, forward is tool +x.
    assert np.array_equal(R_TOOL_CAMERA @ np.eye(3), [[0, 0, 1], [-1, 0, 0], [0, -1, 0]])


def test_image_circle_is_the_limit_angle():
    calibration = CALIBRATIONS["t265"]
    theta = np.arccos(np.clip(calibration.pixel_directions()[..., 2], -1.0, 1.0))
    assert np.array_equal(calibration.outside_circle(), theta > math.radians(81.5))
    assert not CALIBRATIONS["pinhole"].outside_circle().any()


def test_what_the_lens_cannot_see_is_not_finite():
    behind = np.array([[0.1, 0.0, -1.0], [0.0, 0.0, -1.0]])
    for calibration in CALIBRATIONS.values():
        assert not np.isfinite(calibration.project(behind)).all(axis=-1).any()


def test_shipped_eyes_are_64_mm_apart_with_the_left_at_plus_y():
    assert set(NAMES) <= set(list_calibrations())
    for calibration in CALIBRATIONS.values():
        baseline = np.subtract(calibration.p_tool_left_m, calibration.p_tool_right_m)
        assert baseline == pytest.approx([0.0, 0.064, 0.0])


def test_unknown_calibration_names_the_known_ones():
    with pytest.raises(UnknownName) as caught:
        load_calibration("t266")
    assert caught.value.suggestion == "t265"


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("focal = 45.8", "focal = -1.0", "focal"),
        ("focal = 45.8", "", "focal"),
        ("width = 128", "width = 128\nzoom = 2", "zoom"),
        ("k = [-0.008, 0.043, -0.040, 0.007]", "k = [-0.9, 0.0, 0.0, 0.0]", "rise"),
        ("k = [-0.008, 0.043, -0.040, 0.007]", "k = [0.1]", "k"),
        ("width = 128", "width = ", "nvalid"),
    ],
)
def test_bad_files_are_refused(tmp_path, old: str, new: str, problem: str):
    text = (CALIBRATION_FOLDER / "t265.toml").read_text()
    assert old in text
    (tmp_path / "mine.toml").write_text(text.replace(old, new))
    with pytest.raises(BadCalibration, match=problem):
        load_calibration("mine", folder=tmp_path)


def test_calibrations_are_frozen_and_survive_a_round_trip():
    calibration = CALIBRATIONS["t265"]
    fields = tomllib.loads((CALIBRATION_FOLDER / "t265.toml").read_text())
    assert StereoCalibration.model_validate(calibration.model_dump()) == calibration
    assert calibration.lens.model_dump()["focal"] == fields["lens"]["focal"]
    with pytest.raises(ValueError, match="frozen"):
        calibration.width = 64  # type: ignore[misc]
