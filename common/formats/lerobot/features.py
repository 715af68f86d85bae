"""The features of an episode: what they are called and where their rows come from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from common.datasets import DatasetSpec, Episode
from common.formats.labels import Floats, label_column, read_labels
from common.formats.lerobot.layout import ACTION_KEY, EXECUTED_KEY, MOTION_NAMES, STATE_KEY

_POSE_NAMES = ("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz")
_STATE = {
    "tool_pose": tuple(f"tool_{name}" for name in _POSE_NAMES),
    "opening_m": ("opening_m",),
}


@dataclass(frozen=True)
class Feature:
    """A vector per row.

    Args:
        key: Its name there.
        names: Of its numbers.
        read: Rows of an episode, (n, len(names)).
    """

    key: str
    names: tuple[str, ...]
    read: Callable[[Episode], Floats]

    def describe(self) -> dict[str, Any]:
        """Its entry of `info.json`."""
        return {"dtype": "float32", "shape": [len(self.names)], "names": list(self.names)}


def list_features(spec: DatasetSpec) -> list[Feature]:
    """The vectors that a data set has."""
    shapes = {column.name: column.shape for column in spec.columns}
    features = [Feature(ACTION_KEY, (*MOTION_NAMES, "grasp"), lambda e: read_labels(e, spec))]
    state = [
        name
        for name, parts in _STATE.items()
        if shapes.get(name) == (() if len(parts) == 1 else (len(parts),))
    ]
    if state:
        names = tuple(part for name in state for part in _STATE[name])
        features.append(Feature(STATE_KEY, names, lambda e: _read_state(e, state)))
    if label_column(spec) != "action":
        features.append(
            Feature(EXECUTED_KEY, MOTION_NAMES, lambda e: e["action"].astype(np.float64))
        )
    return features


def _read_state(episode: Episode, columns: list[str]) -> Floats:
    parts = [episode[name].astype(np.float64).reshape(len(episode), -1) for name in columns]
    return np.concatenate(parts, axis=1)
