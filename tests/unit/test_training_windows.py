"""Windows: which frames, in which order, how varied."""

import numpy as np
import pytest

from common.errors import InvalidValue
from services.policy.training.config import TrainingConfig
from services.policy.training.data import TrainingData, load_training_data
from services.policy.training.variation import UNIT, draw_variations
from services.policy.training.windows import WindowLoader, list_windows
from tests.training_data import CONFIG, NETWORK, write_dataset

STILL = CONFIG.model_copy(
    update={
        "augmentation": CONFIG.augmentation.model_copy(
            update={"shift_px": 0, "brightness": 0.0, "contrast": 0.0}
        )
    }
)
REMEMBERS = TrainingConfig.model_validate(
    {**CONFIG.model_dump(), "network": {**NETWORK.model_dump(), "history": {"steps": 3}}}
)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> TrainingData:
    return load_training_data([write_dataset(tmp_path_factory.mktemp("w") / "lid")], CONFIG)


def test_an_update_is_always_the_same(data: TrainingData):
    first, second = (WindowLoader(data, CONFIG).batch(7) for _ in range(2))
    assert first.images.equal(second.images)
    assert first.targets.actions.equal(second.targets.actions)
    other = WindowLoader(data, CONFIG).batch(8)
    assert not first.images.equal(other.images)


def test_an_update_does_not_depend_on_those_before_it(data: TrainingData):
    first, second = WindowLoader(data, CONFIG), WindowLoader(data, CONFIG)
    for update in (0, 63, 64, 130):
        first.batch(update)
    assert first.batch(65).images.equal(second.batch(65).images)


@pytest.mark.parametrize("threads", [2, 3, 64])
def test_threads_change_nothing(data: TrainingData, threads: int):
    alone, shared = WindowLoader(data, CONFIG), WindowLoader(data, CONFIG, threads=threads)
    for update in range(20):
        assert alone.batch(update).images.equal(shared.batch(update).images)
    for here, there in zip(alone.validation(), shared.validation(), strict=True):
        assert here.images.equal(there.images)


def test_a_batch_is_overwritten_by_the_next(data: TrainingData):
    loader = WindowLoader(data, CONFIG)
    first = loader.batch(0).images
    kept = first.clone()
    second = loader.batch(1).images
    assert first.equal(second)
    assert not kept.equal(second)


def test_a_batch_that_cannot_be_shared_equally_is_refused(data: TrainingData):
    with pytest.raises(InvalidValue, match="a multiple of 3"):
        WindowLoader(data, CONFIG, rank=0, world_size=3)


def test_windows_stay_within_an_episode_that_is_trained_on(data: TrainingData):
    loader, window = WindowLoader(data, CONFIG), CONFIG.network.window
    rows = loader.draw(np.random.default_rng(0), 20_000)
    inside = np.zeros(len(rows), bool)
    for start, length in data.spans.tolist():
        inside |= (rows >= start) & (rows + window <= start + length)
    assert inside.all()


def test_first_and_last_frames_are_seen_as_often_as_others(data: TrainingData):
    loader, window = WindowLoader(data, CONFIG), CONFIG.network.window
    rows = loader.draw(np.random.default_rng(1), 50_000)
    seen = np.bincount((rows[:, None] + np.arange(window)).ravel(), minlength=len(data.frames))
    start, length = data.spans[0].tolist()
    middle = seen[start + window : start + length - window].mean()
    assert 0.5 < seen[start] / middle < 1.5
    assert 0.5 < seen[start + length - 1] / middle < 1.5


def test_shares_of_processes_make_up_the_batch(data: TrainingData):
    whole = WindowLoader(data, CONFIG).batch(3)
    assert len(whole.images) == CONFIG.batch_windows
    parts = [WindowLoader(data, CONFIG, rank=rank, world_size=2).batch(3) for rank in (0, 1)]
    for rank, part in enumerate(parts):
        assert part.images.equal(whole.images[rank::2])
        assert part.targets.grasp.equal(whole.targets.grasp[rank::2])


def test_without_variation_images_are_the_data(data: TrainingData):
    loader = WindowLoader(data, STILL)
    batch = loader.batch(5)
    (row,) = np.flatnonzero((data.actions == batch.targets.actions[2, 0].numpy()).all(axis=1))
    (window,) = data.frames.windows(np.array([row]), 6)
    np.testing.assert_array_equal(batch.images[2].numpy(), window)


def look_up(images: np.ndarray, down: int, right: int, k: int, d: int) -> np.ndarray:
    """What a variation is, pixel by pixel."""
    px = images.shape[-1]
    index = np.arange(px)
    moved = images[..., np.clip(index - down, 0, px - 1), :][..., np.clip(index - right, 0, px - 1)]
    return np.clip((k * moved.astype(int) + 64) // 128 + d, 0, 255)


@pytest.mark.parametrize(
    ("down", "right", "k", "d"),
    [
        (0, 0, UNIT, 0),
        (2, 0, UNIT, 0),
        (-2, 1, UNIT, 0),
        (1, -2, 100, 30),
        (-1, -1, 150, -60),
        (16, 16, 0, 383),
        (-16, -16, 256, -383),
        (63, -63, 256, 0),
    ],
)
def test_a_shift_repeats_the_edge_and_gray_levels_are_clipped(
    data: TrainingData, down: int, right: int, k: int, d: int
):
    loader = WindowLoader(data, STILL)
    batch = loader.gather(np.array([3, 50]), np.array([[0, 0, UNIT, 0], [down, right, k, d]]))
    plain, source = data.frames.windows(np.array([3, 50]), 6)
    np.testing.assert_array_equal(batch.images[0].numpy(), plain)
    np.testing.assert_array_equal(batch.images[1].numpy(), look_up(source, down, right, k, d))


def test_contrast_is_about_middle_gray_and_within_its_limits():
    limits = CONFIG.augmentation.model_copy(update={"shift_px": 4})
    config = CONFIG.model_copy(update={"augmentation": limits})
    drawn = draw_variations(np.random.default_rng(0), 5000, config)
    assert set(np.unique(drawn[:, :2]).tolist()) == {-2, -1, 0, 1, 2}
    middle = drawn[:, 2] * 127.5 / UNIT + drawn[:, 3] - 127.5
    assert np.abs(middle).max() <= 255 * limits.brightness + 0.5
    assert np.abs(middle.mean()) < 1.0
    contrast = drawn[:, 2] / UNIT
    assert 1 - limits.contrast - 0.005 < contrast.min() < 0.87
    assert 1.13 < contrast.max() < 1 + limits.contrast + 0.005


def test_gray_levels_vary_by_window_and_stay_bytes(data: TrainingData):
    still, varied = WindowLoader(data, STILL), WindowLoader(data, CONFIG)
    means = [loader.batch(2).images.float().mean(dim=(1, 2, 3, 4)) for loader in (still, varied)]
    shifts = (means[1] - means[0]).abs()
    assert float(shifts.max()) > 1.0
    assert float(shifts.max()) < 255.0 * CONFIG.augmentation.brightness + 20.0


def test_histories_are_executed_actions_and_zero_before_the_start(data: TrainingData):
    loader = WindowLoader(data, REMEMBERS)
    start = int(data.spans[1, 0])
    batch = loader.gather(np.array([start]))
    history, loss_history = batch.history[0].numpy(), batch.targets.history[0].numpy()
    assert history.shape == (6, 3, 6)
    assert loss_history.shape == (6, 2, 6)
    assert not history[0].any()
    np.testing.assert_array_equal(history[1, 2], data.executed[start])
    assert not history[1, :2].any()
    np.testing.assert_array_equal(history[4], data.executed[start + 1 : start + 4])
    np.testing.assert_array_equal(loss_history[4], data.executed[start + 2 : start + 4])


def test_validation_covers_every_held_out_frame(data: TrainingData):
    window = CONFIG.network.window
    rows = list_windows(data.validation, window)
    covered = {row + k for row in rows.tolist() for k in range(window)}
    start, length = data.validation[0].tolist()
    assert covered == set(range(start, start + length))
