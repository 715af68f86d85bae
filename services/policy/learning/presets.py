"""Named policies: every method in every size, `<method>-<size>`.

| size | encoder: width, input, stages x blocks, map | LSTM | MLP | parameters | MFLOP per step |
|---|---|---|---|---|---|
| compact | 16, 128 px folded to 64, 3 x 1, 8x8 | 2 x 256 | 2 x 512 | 1.59 M | 39 |
| small | 16, 64 px, 4 x 2, 4x4 | 2 x 400 | 3 x 2048 | 13.18 M | 86 |
| medium | 16, 128 px, 4 x 2, 8x8 | 2 x 400 | 3 x 2048 | 13.18 M | 276 |
| large | 32, 128 px, 4 x 2, 4x4 | 2 x 400 | 3 x 2048 | 17.37 M | 603 |
| paper | 64, 128 px, 4 x 2, 4x4 | 2 x 400 | 3 x 2048 | 33.88 M | 2290 |

Parameters are those of `legato`.

`paper` is the network of the paper with its equal loss weights. The others are made to learn from
little: they normalise key points and layers, see no action history, give the images to the MLP
too, and have a loss of the future that trains their encoders. Their weight of the invariants is
a choice, not the best of several.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from common.errors import UnknownName
from services.policy.learning.config import (
    BcRnnConfig,
    BcRnnLossConfig,
    EncoderConfig,
    FutureLossConfig,
    HistoryConfig,
    InvariantLossConfig,
    LegatoConfig,
    LegatoLossConfig,
    LegatoSe3Config,
    LegatoSe3LossConfig,
    LstmConfig,
    MixtureConfig,
    MlpConfig,
    PolicyConfig,
)

_COMPACT_WEIGHT = 0.02
_COMPACT_MIXTURE = MixtureConfig(std_floor=0.1)
"""Demonstrators stand still exactly: with a smaller floor those frames rule the gradient."""


_ENCODERS: Mapping[str, EncoderConfig] = MappingProxyType(
    {
        "compact": EncoderConfig(
            width=16, fold=2, stages=3, blocks=1, map_px=8, keypoint_batchnorm=True
        ),
        "small": EncoderConfig(width=16, input_px=64, map_px=4, keypoint_batchnorm=True),
        "medium": EncoderConfig(width=16, input_px=128, map_px=8, keypoint_batchnorm=True),
        "large": EncoderConfig(width=32, input_px=128, map_px=4, keypoint_batchnorm=True),
        "paper": EncoderConfig(),
    }
)


def _sized(size: str) -> dict[str, Any]:
    """The parts of a config that follow from the size."""
    mlp = MlpConfig(layers=2, width=512) if size == "compact" else MlpConfig()
    if size != "paper":
        mlp = mlp.model_copy(update={"layer_norm": True, "sees_images": True})
    history = HistoryConfig() if size == "paper" else HistoryConfig(steps=0)
    lstm = LstmConfig(width=256) if size == "compact" else LstmConfig()
    sized = {"encoder": _ENCODERS[size], "lstm": lstm, "mlp": mlp, "history": history}
    return sized if size == "paper" else {**sized, "mixture": _COMPACT_MIXTURE}


def _legato(size: str) -> LegatoConfig:
    weight = 1.0 if size == "paper" else _COMPACT_WEIGHT
    loss = LegatoLossConfig(invariant=InvariantLossConfig(weight=weight), future=_future(size))
    return LegatoConfig(loss=loss, **_sized(size))


def _future(size: str) -> FutureLossConfig | None:
    """The paper has no such loss; compact networks learn to see by it."""
    return None if size == "paper" else FutureLossConfig()


PRESETS: Mapping[str, PolicyConfig] = MappingProxyType(
    {f"legato-{size}": _legato(size) for size in _ENCODERS}
    | {
        f"legato-se3-{size}": LegatoSe3Config(
            loss=LegatoSe3LossConfig(future=_future(size)), **_sized(size)
        )
        for size in _ENCODERS
    }
    | {
        f"bc-rnn-{size}": BcRnnConfig(loss=BcRnnLossConfig(future=_future(size)), **_sized(size))
        for size in _ENCODERS
    }
)


def load_preset(name: str) -> PolicyConfig:
    """The config of a name.

    Raises:
        UnknownName: No such preset.
    """
    if name not in PRESETS:
        raise UnknownName("policy preset", name, sorted(PRESETS))
    return PRESETS[name]
