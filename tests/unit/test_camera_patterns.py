"""Patterns: who has which, that they turn with the thing, and that they fade before they alias."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from numba import njit

from common.calibration import load_calibration
from services.sim.camera import StereoCamera
from services.sim.camera.patterns import (
    PATTERNS,
    PLAIN,
    RINGS,
    SPECKLE,
    STRIPES,
    TOP_CHECKER,
    find_pattern,
    speckle,
    tone_of,
    wave_of,
)


@njit
def wave(kind, world, local, period, salt):
    """`wave_of`, which only kernels can call."""
    return wave_of(kind, world, local, period, salt)


def look_at(name: str, *, quat: str = "1 0 0 0", kind: str = "box", shadows: bool = False):
    """What both eyes see of one geom half a metre ahead."""
    model = mujoco.MjModel.from_xml_string(f"""
    <mujoco><worldbody><site name="tool"/>
      <geom name="{name}" type="{kind}" size="0.2 0.2 0.2" pos="0.6 0 0" quat="{quat}"/>
    </worldbody></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    camera = StereoCamera(model, load_calibration("t265"), tool_site="tool", shadows=shadows)
    return np.frombuffer(b"".join(camera.render(data)), dtype=np.uint8).reshape(2, 128, 128)


@pytest.mark.parametrize("pattern", [p for p in PATTERNS if p.kind != TOP_CHECKER])
def test_things_of_the_tasks_have_their_patterns(pattern):
    plain, patterned = look_at("thing"), look_at(f"{pattern.prefix}_0")
    assert np.abs(plain.astype(int) - patterned).max() > 10
    assert np.array_equal(plain, look_at("thing_0"))


@pytest.mark.parametrize("prefix", ["cabinet", "stove"])
@pytest.mark.parametrize("kind", ["sphere", "box"])
def test_patterns_turn_with_the_thing(prefix: str, kind: str):
    # A quarter turn of a cube or ball about the view axis: only the pattern can show it.
    quarter = "0.70710678 0.70710678 0 0"
    plain = np.abs(
        look_at("thing", kind=kind).astype(int) - look_at("thing", kind=kind, quat=quarter)
    )
    turned = np.abs(
        look_at(prefix, kind=kind).astype(int) - look_at(prefix, kind=kind, quat=quarter)
    )
    assert (plain > 8).mean() < 0.002
    assert (turned > 8).mean() > 0.005


def test_speckles_of_different_geoms_differ():
    assert not np.array_equal(look_at("pot_wall_0"), look_at("pot_wall_1"))


def test_the_first_pattern_that_fits_wins_and_others_are_plain():
    assert find_pattern("pot_wall_3").kind == SPECKLE
    assert find_pattern("cabinet_top").kind == STRIPES
    assert find_pattern("lid_disc").kind == RINGS
    assert find_pattern("robot_table").kind == PLAIN
    assert find_pattern("").kind == PLAIN


def test_waves_are_the_formulas():
    origin = (0.0, 0.0, 0.0)
    assert wave(TOP_CHECKER, (0.1, 0.1, 0.0), origin, 0.25, 0) == 1.0
    assert wave(TOP_CHECKER, (0.3, 0.1, 0.0), origin, 0.25, 0) == -1.0
    assert wave(TOP_CHECKER, (-0.1, 0.1, 0.0), origin, 0.25, 0) == -1.0
    assert wave(STRIPES, origin, (0.02, 0.02, 0.01), 0.04, 0) == -1.0
    assert wave(RINGS, origin, (0.03, 0.04, 9.0), 0.04, 0) == -1.0
    assert wave(SPECKLE, origin, (0.1, 0.2, 0.3), 0.04, 5) == wave(
        SPECKLE, origin, (0.101, 0.199, 0.3), 0.04, 5
    )


def test_speckles_fill_their_range_evenly():
    values = np.array(
        [speckle.py_func(x, y, z, 7) for x in range(-8, 8) for y in range(-8, 8) for z in range(8)]
    )
    assert np.abs(values).max() <= 1.0
    counts, _ = np.histogram(values, bins=8, range=(-1.0, 1.0))
    assert counts.min() > 0.8 * counts.mean()
    grid = values.reshape(16, 16, 8)
    for axis in range(3):
        neighbours = np.moveaxis(grid, axis, 0)
        assert abs(np.corrcoef(neighbours[1:].ravel(), neighbours[:-1].ravel())[0, 1]) < 0.1


def test_patterns_fade_where_the_picture_cannot_show_them():
    tone = tone_of.py_func
    assert tone(1.0, 0.6, 8.0) == 1.0
    assert tone(-1.0, 0.6, 8.0) == pytest.approx(0.6)
    assert tone(1.0, 0.6, 2.0) == tone(-1.0, 0.6, 2.0) == tone(1.0, 0.6, 0.5) == pytest.approx(0.8)
    assert tone(1.0, 0.6, 3.0) > tone(1.0, 0.6, 2.5) > 0.8


def test_adaptive_and_full_grid_show_the_same_pattern():
    model = mujoco.MjModel.from_xml_string("""
    <mujoco><worldbody><site name="tool"/>
      <geom name="stove" type="cylinder" size="0.3 0.4" pos="0.7 0 0" quat="0.9 0.1 0.2 0.3"/>
    </worldbody></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    adaptive, full = (
        np.frombuffer(
            StereoCamera(
                model, load_calibration("t265"), tool_site="tool", full_grid=full_grid
            ).render(data)[0],
            dtype=np.uint8,
        ).astype(int)
        for full_grid in (False, True)
    )
    assert (np.abs(adaptive - full) <= 3).mean() > 0.995
