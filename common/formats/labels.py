"""What every format needs of a recording: labels, histories, stereo pairs."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from common.datasets import DatasetSpec, Episode, EpisodeStore
from common.datasets.errors import NotExportable
from common.datasets.spec import IMAGES

Floats = npt.NDArray[np.float64]
Bytes = npt.NDArray[np.uint8]

NEEDED = (IMAGES, "action", "grasp")
HISTORY_STEPS = 2


def check_exportable(store: EpisodeStore) -> None:
    """See that there is something to export.

    Raises:
        NotExportable: No episode, or a column is missing or has another shape.
    """
    spec = store.spec
    shapes = {column.name: column.shape for column in spec.columns}
    for name in NEEDED:
        if name not in shapes:
            raise NotExportable(str(store.folder), f"there is no column {name}")
    for name, shape in (("action", (6,)), ("intended", (6,)), ("grasp", ())):
        if shapes.get(name, shape) != shape:
            raise NotExportable(str(store.folder), f"column {name} has rows of {shapes[name]}")
    if not store.episodes:
        raise NotExportable(str(store.folder), "there is no episode")


def label_column(spec: DatasetSpec) -> str:
    """Column of what is to be learned: `intended` where a noisy demonstrator did something else."""
    named = {column.name for column in spec.columns}
    return "intended" if "intended" in named else "action"


def read_labels(episode: Episode, spec: DatasetSpec) -> Floats:
    """(n, 7) dx dy dz rx ry rz [m, rad] and grasp, 1 = close."""
    motion = episode[label_column(spec)].astype(np.float64)
    grasp = episode["grasp"].astype(np.float64)[:, None]
    return np.concatenate([motion, grasp], axis=1)


def list_history(actions: Floats, steps: int = HISTORY_STEPS) -> Floats:
    """(n, steps, 6) actions that were executed before each row: oldest first, zero at the start."""
    past = np.zeros((len(actions), steps, actions.shape[1]))
    for back in range(1, min(steps, len(actions)) + 1):
        past[back:, steps - back] = actions[: len(actions) - back]
    return past


def read_eye(episode: Episode, eye: int) -> Bytes:
    """(n, height, width) gray images of one eye, 0 = left."""
    return np.asarray(episode[IMAGES][:, eye], dtype=np.uint8)


def spread(count: int, held: int) -> list[int]:
    """Numbers of `held` of `count` things, evenly spread."""
    if held == 0:
        return []
    chosen = np.linspace(0, count - 1, held + 2).round().astype(int)[1:-1]
    return sorted(set(chosen.tolist()))
