"""A small data set and config to train on."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from common.datasets import DatasetSpec, EpisodeMetadata, EpisodeRows, EpisodeWriter, Rows
from services.policy.learning.config import (
    EncoderConfig,
    FutureLossConfig,
    HistoryConfig,
    LegatoConfig,
    LegatoLossConfig,
    LstmConfig,
    MlpConfig,
)
from services.policy.training.config import OptimiserConfig, PretrainingConfig, TrainingConfig
from services.recorder.columns import describe_dataset

NETWORK = LegatoConfig(
    encoder=EncoderConfig(
        width=4, input_px=64, stages=3, map_px=8, keypoints=4, features=8, keypoint_batchnorm=True
    ),
    history=HistoryConfig(steps=0),
    lstm=LstmConfig(layers=1, width=16),
    mlp=MlpConfig(layers=1, width=16),
    window=6,
)
CONFIG = TrainingConfig(
    network=NETWORK,
    timesteps=6 * 4 * 12,
    batch_windows=4,
    optimiser=OptimiserConfig(learning_rate=3e-3, warmup_steps=2),
    precision="fp32",
    validation_share=0.25,
)
FORESEEING = CONFIG.model_copy(
    update={
        "network": NETWORK.model_copy(
            update={"loss": LegatoLossConfig(future=FutureLossConfig(horizons=(1, 3, 8)))}
        ),
        "pretraining": PretrainingConfig(frames=320, batch_frames=8, learning_rate=3e-3),
    }
)
"""The encoders are trained alone first, for 40 updates."""


def make_rows(spec: DatasetSpec, length: int, *, seed: int) -> EpisodeRows:
    """An episode of random numbers; what was meant is half of what was done."""
    random = np.random.default_rng(seed)
    columns: dict[str, Rows] = {}
    for column in spec.columns:
        shape = (length, *column.shape)
        if column.dtype == "u8":
            columns[column.name] = random.integers(0, 2, shape).astype(np.uint8)
        elif column.dtype == "i64":
            columns[column.name] = np.broadcast_to(10 * np.arange(length), shape).copy()
        else:
            columns[column.name] = random.normal(0.0, 0.01, shape)
    columns["images"] = random.integers(0, 256, (length, 2, 128, 128)).astype(np.uint8)
    columns["intended"] = 0.5 * columns["action"].astype(np.float64)
    return EpisodeRows(columns)


def write_dataset(
    folder: Path, lengths: tuple[int, ...] = (20, 25, 30, 22), *, failed: tuple[int, ...] = ()
) -> Path:
    """A data set of the lid task with episodes of these lengths."""
    spec = describe_dataset(task="lid", robot="abstract", camera="t265", recording={}, software={})
    with EpisodeWriter.open(folder, spec) as writer:
        for number, length in enumerate(lengths):
            outcome = "failure" if number in failed else "success"
            metadata = EpisodeMetadata(trial=number, seed=number, outcome=outcome, details={})
            writer.append(make_rows(spec, length, seed=number), metadata)
    return folder
