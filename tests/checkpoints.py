"""Checkpoints of small networks with random weights."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import torch

from services.policy.learning.checkpoint import (
    CheckpointCard,
    CheckpointConfig,
    DatasetSummary,
    ImageSpec,
    save_checkpoint,
)
from services.policy.learning.config import BcRnnConfig, LegatoConfig, LegatoSe3Config
from services.policy.learning.network import PolicyNetwork
from services.policy.learning.normalization import ActionStatistics

METHODS = {"legato": LegatoConfig, "legato-se3": LegatoSe3Config, "bc-rnn": BcRnnConfig}

SMALL = {
    "encoder": {"width": 4, "input_px": 64, "map_px": 2, "keypoints": 4, "features": 8},
    "lstm": {"layers": 2, "width": 8},
    "mlp": {"layers": 2, "width": 16},
    "mixture": {"modes": 3},
    "window": 6,
}


def make_network(*, method: str = "legato", seed: int = 0, **changes: object) -> PolicyNetwork:
    """A small network whose normalisations are not the identity."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        network = PolicyNetwork(METHODS[method].model_validate(SMALL | changes))
        for name, buffer in network.named_buffers():
            if name.endswith("running_mean"):
                buffer.normal_(0.0, 0.1)
            elif name.endswith("running_var"):
                buffer.uniform_(0.5, 1.5)
    return network


def make_config(network: PolicyNetwork, **changes: object) -> CheckpointConfig:
    fields = {
        "network": network.config.model_dump(),
        "image": ImageSpec(px=network.config.encoder.input_px),
        "tasks": ("lid",),
        "seed": 3,
    }
    return CheckpointConfig.model_validate(fields | changes)


def make_statistics() -> ActionStatistics:
    actions = np.random.default_rng(0).normal(0.0, 1.0, size=(500, 6))
    return ActionStatistics.of(actions * [0.01, 0.01, 0.005, 0.03, 0.02, 0.02])


def make_card() -> CheckpointCard:
    return CheckpointCard(
        command="legato train --task lid",
        created=datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC),
        versions={"legato": "0", "torch": "2"},
        git_revision=None,
        dataset=DatasetSummary(sha256="ab" * 32, episodes=2, frames=300, robots=("abstract",)),
        steps=10,
        timesteps=3200,
        minutes=1.5,
        losses={"total": 1.25},
    )


def write_checkpoint(folder: Path, *, tasks: tuple[str, ...] = ("lid",), **network: object) -> Path:
    """A checkpoint of `make_network`; its folder."""
    made = make_network(**network)  # type: ignore[arg-type]
    save_checkpoint(
        folder,
        made,
        config=make_config(made, tasks=tasks),
        statistics=make_statistics(),
        card=make_card(),
    )
    return folder
