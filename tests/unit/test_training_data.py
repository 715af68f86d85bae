"""What training makes of a data set."""

from pathlib import Path

import numpy as np
import pytest

from common.datasets import EpisodeStore
from services.policy.learning.images import reduce_images
from services.policy.training.config import TrainingConfig
from services.policy.training.data import TrainingData, load_training_data
from services.policy.training.errors import BadTrainingData
from tests.training_data import CONFIG, write_dataset


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_dataset(tmp_path_factory.mktemp("data") / "lid")


@pytest.fixture(scope="module")
def data(folder: Path) -> TrainingData:
    return load_training_data([folder], CONFIG)


def see(data: TrainingData, row: int, length: int) -> np.ndarray:
    """Images of some rows of one episode."""
    (window,) = data.frames.windows(np.array([row]), length)
    return window


def test_labels_are_what_was_meant_and_histories_what_was_done(folder: Path, data: TrainingData):
    store = EpisodeStore.open(folder)
    done = np.asarray(store.column("action"), np.float64)
    np.testing.assert_allclose(data.executed, done.astype(np.float32))
    np.testing.assert_allclose(data.actions, (0.5 * done).astype(np.float32))


def test_images_are_those_of_deployment(folder: Path, data: TrainingData):
    raw = np.asarray(EpisodeStore.open(folder).column("images"), np.uint8)
    np.testing.assert_array_equal(see(data, 0, 20), reduce_images(raw[:20], input_px=64))
    np.testing.assert_array_equal(see(data, 47, 20), reduce_images(raw[47:67], input_px=64))


def test_images_of_full_size_stay_in_their_file(tmp_path: Path):
    folder = write_dataset(tmp_path / "lid", (20, 22, 21), failed=(1,))
    encoder = {**CONFIG.network.encoder.model_dump(), "input_px": 128}
    network = {**CONFIG.network.model_dump(), "encoder": encoder}
    config = TrainingConfig.model_validate({**CONFIG.model_dump(), "network": network})
    data = load_training_data([folder], config)
    assert data.frames.px == 128
    store = EpisodeStore.open(folder)
    (window,) = data.frames.windows(np.array([25]), 6)
    assert not window.flags.writeable
    np.testing.assert_array_equal(window, np.asarray(store.column("images"))[47:53])


def test_grasp_labels_come_early_within_their_episode(folder: Path, data: TrainingData):
    grasp = np.asarray(EpisodeStore.open(folder).column("grasp"))
    lead = CONFIG.grasp_lead_steps
    assert lead > 0
    start, length = 20, 25
    mine = data.grasp[start : start + length]
    np.testing.assert_array_equal(mine[:-lead], grasp[start + lead : start + length])
    assert set(mine[-lead:].tolist()) == {float(grasp[start + length - 1])}


def test_held_out_episodes_are_not_trained_on(data: TrainingData):
    trained, held = set(data.spans[:, 0].tolist()), set(data.validation[:, 0].tolist())
    assert len(trained) == 3
    assert len(held) == 1
    assert not trained & held
    assert data.origin.episodes == 4
    assert len(data.training_actions()) == int(data.spans[:, 1].sum())


def test_failed_short_and_long_episodes_are_left_out(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
):
    short, long = CONFIG.network.window - 1, 35
    folder = write_dataset(tmp_path / "lid", (20, short, long, 20, 20), failed=(3,))
    config = CONFIG.model_copy(update={"longest_episode_s": 3.0, "validation_share": 0.5})
    data = load_training_data([folder], config)
    assert data.origin.left_out == 3
    assert data.origin.rows == 40
    assert "3 episodes are left out" in caplog.text


def test_data_sets_are_put_behind_each_other(folder: Path, data: TrainingData):
    both = load_training_data([folder, folder], CONFIG)
    assert both.origin.rows == 2 * data.origin.rows
    first = data.origin.rows
    np.testing.assert_array_equal(see(both, first + 20, 25), see(data, 20, 25))
    np.testing.assert_array_equal(both.actions[first:], data.actions)
    assert both.origin.sha256 != data.origin.sha256


def test_no_usable_episode_is_an_error(tmp_path: Path):
    folder = write_dataset(tmp_path / "lid", (20, 20), failed=(0, 1))
    with pytest.raises(BadTrainingData, match="no successful episode"):
        load_training_data([folder], CONFIG)


def test_too_few_episodes_to_hold_any_out_are_an_error(tmp_path: Path):
    folder = write_dataset(tmp_path / "lid", (20,))
    with pytest.raises(BadTrainingData, match="at least one on either side"):
        load_training_data([folder], CONFIG)
