"""Sensor noise: off by default, a function of seed and step only, and as strong as asked for."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from common.calibration import load_calibration
from common.errors import InvalidValue
from services.sim.camera.noise import CameraNoise, Sensor

T265 = load_calibration("t265")
INSIDE = ~T265.outside_circle()
SIZE = T265.width * T265.height
GRAY = (bytes([120]) * SIZE, bytes([120]) * SIZE)
STRONG = CameraNoise(noise_std=5.0, exposure_gain=(0.7, 1.3), vignette_strength=(0.1, 0.5))


def expose(noise: CameraNoise, *, seed: int = 3, step: int = 0, pair=GRAY) -> np.ndarray:
    left, right = Sensor(T265, noise, seed=seed).expose(*pair, step=step)
    return np.frombuffer(left + right, dtype=np.uint8).reshape(2, T265.height, T265.width)


def test_it_is_off_as_built():
    assert CameraNoise().is_off
    assert Sensor(T265, CameraNoise(), seed=1).expose(*GRAY, step=5) == GRAY


def test_a_frame_depends_on_seed_and_step_only():
    sensor = Sensor(T265, STRONG, seed=3)
    frames = {step: sensor.expose(*GRAY, step=step) for step in (0, 10, 20)}
    assert len(set(frames.values())) == 3
    again = Sensor(T265, STRONG, seed=3)
    assert {step: again.expose(*GRAY, step=step) for step in (20, 0, 10)} == frames
    assert Sensor(T265, STRONG, seed=4).expose(*GRAY, step=0) != frames[0]


def test_noise_is_as_strong_as_asked_for_and_differs_between_eyes():
    shown = expose(CameraNoise(noise_std=5.0)).astype(float) - 120.0
    left, right = shown[:, INSIDE]
    assert np.std(left) == pytest.approx(5.0, rel=0.03)
    assert np.mean(left) == pytest.approx(0.0, abs=0.2)
    assert abs(np.corrcoef(left, right)[0, 1]) < 0.05


def test_gain_is_one_number_of_the_range_per_episode():
    gains: set[float] = set()
    for seed in range(30):
        first, later = (
            expose(CameraNoise(exposure_gain=(0.5, 1.5)), seed=seed, step=step)[:, INSIDE]
            for step in (0, 40)
        )
        assert np.array_equal(first, later)
        assert np.ptp(first) == 0
        gains.add(float(first[0, 0]) / 120.0)
    assert min(gains) < 0.7
    assert max(gains) > 1.3
    assert all(0.49 < gain < 1.51 for gain in gains)


def test_vignetting_darkens_towards_the_rim():
    shown = expose(CameraNoise(vignette_strength=(0.5, 0.5)))[0]
    assert shown[64, 64] == 120
    assert shown[INSIDE].min() == 60
    assert (np.diff(shown[64, 64:120].astype(int)) <= 0).all()


def test_outside_the_image_circle_it_stays_black_and_bytes_saturate():
    assert (expose(STRONG)[:, ~INSIDE] == 0).all()
    white = (bytes([255]) * SIZE,) * 2
    assert expose(CameraNoise(exposure_gain=(4.0, 4.0)), pair=white)[:, INSIDE].min() == 255


@pytest.mark.parametrize(
    "fields",
    [
        {"noise_std": -1.0},
        {"exposure_gain": (1.2, 0.8)},
        {"vignette_strength": (0.0, 1.5)},
        {"exposure_gain": (0.0, 1.0)},
        {"blur": 1.0},
    ],
)
def test_impossible_settings_are_refused(fields: dict[str, object]):
    with pytest.raises(ValidationError):
        CameraNoise.model_validate(fields)


def test_pictures_of_another_size_and_negative_numbers_are_refused():
    with pytest.raises(InvalidValue, match="seed"):
        Sensor(T265, STRONG, seed=-1)
    sensor = Sensor(T265, STRONG, seed=0)
    with pytest.raises(InvalidValue, match="right"):
        sensor.expose(GRAY[0], b"\0", step=0)
    with pytest.raises(InvalidValue, match="step"):
        sensor.expose(*GRAY, step=-1)
