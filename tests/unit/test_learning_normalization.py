from __future__ import annotations

import numpy as np
import pytest
import torch
from pydantic import ValidationError

from common.errors import InvalidValue
from services.policy.learning.images import reduce_images
from services.policy.learning.images_torch import reduce_images_torch
from services.policy.learning.normalization import ActionStatistics


def test_scale_is_the_quantile_range_with_a_margin():
    ramp = np.linspace(-0.02, 0.01, 101)
    actions = np.zeros((101, 6))
    actions[:, 0] = ramp
    actions[:, 5] = 10.0 * ramp
    statistics = ActionStatistics.of(actions)
    expected = [1.2 * 0.0197, 1e-3, 1e-3, 5e-3, 5e-3, 1.2 * 0.197]
    np.testing.assert_allclose(statistics.scale, expected)
    np.testing.assert_allclose(statistics.translation.q01[0], -0.0197)
    np.testing.assert_allclose(statistics.translation.q99[0], 0.0097)


def test_outliers_are_counted_not_followed():
    actions = np.random.default_rng(0).normal(size=(1000, 6)) * 0.01
    plain = ActionStatistics.of(actions)
    actions[:5, 1] = 1.0
    spoiled = ActionStatistics.of(actions)
    assert spoiled.scale[1] < 1.2 * plain.scale[1]
    assert spoiled.translation.outside[1] >= 0.005


def test_rest_is_counted():
    actions = np.ones((4, 6))
    actions[3] = 0.0
    statistics = ActionStatistics.of(actions)
    assert statistics.zero_share == 0.25
    assert statistics.count == 4


def test_motion_scale_is_the_root_mean_square_length():
    actions = np.random.default_rng(0).normal(size=(100, 6)) * 0.02
    scale = ActionStatistics.of(actions).motion_scale
    assert scale.step_m == pytest.approx(np.sqrt(np.mean(np.sum(actions[:, :3] ** 2, axis=1))))
    assert scale.turn_rad == pytest.approx(np.sqrt(np.mean(np.sum(actions[:, 3:] ** 2, axis=1))))


def test_a_data_set_at_rest_has_units_all_the_same():
    statistics = ActionStatistics.of(np.zeros((3, 6), dtype=np.float32))
    assert statistics.scale == (1e-3,) * 3 + (5e-3,) * 3
    assert (statistics.motion_scale.step_m, statistics.motion_scale.turn_rad) == (1e-3, 5e-3)


def test_json_round_trip_is_exact():
    statistics = ActionStatistics.of(np.random.default_rng(1).normal(size=(50, 6)) * 0.01)
    assert ActionStatistics.model_validate_json(statistics.model_dump_json()) == statistics


def test_unordered_quantiles_and_unknown_fields_are_refused():
    fields = ActionStatistics.of(np.ones((2, 6))).model_dump()
    with pytest.raises(ValidationError, match="extra"):
        ActionStatistics.model_validate(fields | {"mean": 0.0})
    fields["rotation"]["q01"] = (2.0, 0.0, 0.0)
    with pytest.raises(ValidationError, match="q01 is above q99"):
        ActionStatistics.model_validate(fields)


@pytest.mark.parametrize(
    "actions", [np.zeros((0, 6)), np.zeros((3, 7)), np.zeros(6), np.full((2, 6), np.nan)]
)
def test_bad_actions_are_refused(actions: np.ndarray):
    with pytest.raises(InvalidValue, match="actions"):
        ActionStatistics.of(actions)


def random_images() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (3, 2, 128, 128), dtype=np.uint8)


def test_the_mean_of_four_pixels_rounded_half_up():
    images = random_images()
    means = images.reshape(3, 2, 64, 2, 64, 2).astype(float).mean(axis=(3, 5))
    assert np.array_equal(reduce_images(images, input_px=64), np.floor(means + 0.5))


def test_white_stays_white():
    assert (reduce_images(np.full((128, 128), 255, np.uint8), input_px=64) == 255).all()


@pytest.mark.parametrize("input_px", [64, 128])
def test_numpy_and_torch_agree(input_px: int):
    images = random_images()
    twin = reduce_images_torch(torch.from_numpy(images), input_px=input_px)
    reduced = reduce_images(images, input_px=input_px)
    assert reduced.dtype == np.uint8
    assert twin.dtype == torch.uint8
    assert np.array_equal(reduced, twin.numpy())


def test_other_sizes_are_refused():
    for images in (np.zeros((2, 64, 64), np.uint8), np.zeros(128, np.uint8)):
        with pytest.raises(InvalidValue, match="images"):
            reduce_images(images, input_px=64)
        with pytest.raises(InvalidValue, match="images"):
            reduce_images_torch(torch.from_numpy(images), input_px=64)
    with pytest.raises(InvalidValue, match="input_px"):
        reduce_images(np.zeros((128, 128), np.uint8), input_px=96)
