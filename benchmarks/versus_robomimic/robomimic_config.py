"""robomimic's config of the paper's BC-RNN; runs in robomimic's environment.

Two ResNet18 encoders with spatial softmax (32 key points, 64 features), LSTM of 2 x 400, MLP of
3 x 2048, 5 modes over 7 values; the last two executed actions as further input.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from robomimic.config import config_factory

WINDOW = 20
IMAGES = ("left_gray", "right_gray")
HISTORY = ("delta_positions", "delta_eulers")
_CORE = {
    "feature_dimension": 64,
    "flatten": True,
    "backbone_class": "ResNet18Conv",
    "backbone_kwargs": {"pretrained": False},
    "pool_class": "SpatialSoftmax",
    "pool_kwargs": {"num_kp": 32, "learnable_temperature": False, "temperature": 1.0},
}


def make_config(data: Path, *, output: Path, batch: int, cache: str) -> Any:
    """The config.

    Args:
        data: HDF5 file.
        output: Folder for what robomimic writes.
        batch: Windows per update.
        cache: What robomimic keeps in memory: `all` or `low_dim`.
    """
    config = config_factory("bc")
    with config.values_unlocked():
        config.experiment.name = "legato"
        config.experiment.rollout.enabled = False
        config.experiment.save.enabled = False
        config.experiment.logging.log_tb = False
        config.experiment.logging.terminal_output_to_txt = False
        config.train.data, config.train.output_dir = str(data), str(output)
        config.train.cuda = False
        config.train.hdf5_cache_mode = cache
        config.train.hdf5_filter_key = "train"
        config.train.batch_size, config.train.seq_length = batch, WINDOW
        config.observation.modalities.obs.low_dim = list(HISTORY)
        config.observation.modalities.obs.rgb = list(IMAGES)
        config.observation.encoder.rgb.core_kwargs = _CORE
        config.algo.gmm.enabled = config.algo.rnn.enabled = True
        # Else validation takes a deviation of 1e-4, by which every likelihood vanishes.
        config.algo.gmm.low_noise_eval = False
        config.algo.rnn.horizon = WINDOW
        config.algo.actor_layer_dims = (2048, 2048, 2048)
    return config
