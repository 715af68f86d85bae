"""Demonstrations as training needs them: images at the network's size, labels made."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt
import torch

from common.datasets import EpisodeStore
from common.datasets.index import EpisodeInfo
from services.policy.learning.config import FutureLossConfig, GraspLossConfig, NetworkConfig
from services.policy.learning.images import CAMERA_PX, Images, reduce_images
from services.policy.learning.losses import compute_grasp_weights
from services.policy.training.config import TrainingConfig
from services.policy.training.errors import BadTrainingData
from services.policy.training.frames import Frames
from services.policy.training.future import look_ahead

_REDUCE_ROWS = 2048

Floats = npt.NDArray[np.float32]
Spans = npt.NDArray[np.int64]
Scalar = TypeVar("Scalar", bound=np.generic)

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class DataOrigin:
    """What is said of the data in a checkpoint.

    Args:
        folders: As they were given.
        sha256: Over the hashes of all episodes used, in order.
        tasks: Of the data sets.
        robots: Of the data sets.
        episodes: Number used, held-out ones included.
        left_out: Number not used: failed, too short, or too long.
        rows: Frames of the episodes used.
    """

    folders: tuple[str, ...]
    sha256: str
    tasks: tuple[str, ...]
    robots: tuple[str, ...]
    episodes: int
    left_out: int
    rows: int


@dataclass(frozen=True)
class TrainingData:
    """All rows of the chosen episodes, one after the other.

    Args:
        frames: Images of all rows; those of 128 px stay where they are, in the data set's file.
        actions: (rows, 6) [m, rad] what is to be learned.
        grasp: (rows,) 1 = closed; early by the config's lead.
        grasp_weight: (rows,) in the grasp loss.
        executed: (rows, 6) [m, rad] what was done: histories are made of it.
        future: (rows, horizons, 6) where the hand is seen to be later, in units of its spread.
        spans: (episodes, 2) first row and length of those that are trained on.
        validation: The same of those that are held out.
        origin: Where all of it comes from.
    """

    frames: Frames
    actions: Floats
    grasp: Floats
    grasp_weight: Floats
    executed: Floats
    future: Floats
    spans: Spans
    validation: Spans
    origin: DataOrigin

    def training_actions(self) -> Floats:
        """(n, 6) actions of the episodes that are trained on: what statistics are made of."""
        parts = [self.actions[start : start + length] for start, length in self.spans.tolist()]
        return np.concatenate(parts)


def load_training_data(
    folders: Sequence[Path], config: TrainingConfig, *, episodes: int | None = None
) -> TrainingData:
    """Read data sets.

    Args:
        folders: Of the data sets.
        config: Size of the images, labels, what is held out.
        episodes: Use only as many of each data set; None = all.

    Raises:
        NoDataset: A folder is none.
        BadDataset: A file is damaged.
        BadTrainingData: Images of another size, or nothing left to train on.
    """
    parts = [_load_part(EpisodeStore.open(folder), config, episodes) for folder in folders]
    if not any(part.infos for part in parts):
        told = ", ".join(str(folder) for folder in folders)
        raise BadTrainingData(told, "no successful episode of a usable length", "at least 2")
    lengths = [info.length for part in parts for info in part.infos]
    starts = np.concatenate([[0], np.cumsum(lengths)[:-1]]).astype(np.int64)
    spans = np.stack([starts, np.array(lengths, np.int64)], axis=1)
    share = config.validation_share
    held = max(1, round(share * len(spans))) if share > 0 else 0
    if len(spans) <= held:
        told = f"{len(spans)} episodes with validation_share {config.validation_share}"
        raise BadTrainingData(str(folders[0]), told, "at least one on either side")
    digest = hashlib.sha256("".join(i.sha256 for p in parts for i in p.infos).encode())
    chosen = _spread(len(spans), held)
    return TrainingData(
        frames=Frames([images for part in parts for images in part.images]),
        actions=_join([part.actions for part in parts]),
        grasp=_join([part.grasp for part in parts]),
        grasp_weight=_join([part.grasp_weight for part in parts]),
        executed=_join([part.executed for part in parts]),
        future=_load_future(parts, spans, config.network.loss.future),
        spans=spans[~chosen],
        validation=spans[chosen],
        origin=DataOrigin(
            folders=tuple(str(folder) for folder in folders),
            sha256=digest.hexdigest(),
            tasks=tuple(sorted({part.store.spec.task for part in parts})),
            robots=tuple(sorted({part.store.spec.robot for part in parts})),
            episodes=len(spans),
            left_out=sum(part.left_out for part in parts),
            rows=int(sum(lengths)),
        ),
    )


@dataclass(frozen=True)
class _Part:
    """What is used of one data set."""

    store: EpisodeStore
    infos: list[EpisodeInfo]
    left_out: int
    images: list[Images]
    actions: Floats
    grasp: Floats
    grasp_weight: Floats
    executed: Floats


def _load_part(store: EpisodeStore, config: TrainingConfig, episodes: int | None) -> _Part:
    longest = round(config.longest_episode_s * store.spec.rate_hz)
    considered = store.episodes[:episodes]
    infos = [
        info
        for info in considered
        if info.outcome == "success" and config.network.window <= info.length <= longest
    ]
    left_out = len(considered) - len(infos)
    if left_out:
        log.warning("%s: %d episodes are left out", store.folder, left_out)
    named = {column.name for column in store.spec.columns}
    label = "intended" if "intended" in named else "action"
    grasp = [_lead(_rows(store, info, "grasp"), config.grasp_lead_steps) for info in infos]
    return _Part(
        store=store,
        infos=infos,
        left_out=left_out,
        images=_load_images(store, infos, config.network.encoder.input_px),
        actions=_load(store, infos, label),
        grasp=_join([*grasp, np.empty(0, np.float32)]),
        grasp_weight=_join([_weigh(g, config.network) for g in grasp] + [np.empty(0, np.float32)]),
        executed=_load(store, infos, "action"),
    )


def _load_future(parts: Sequence[_Part], spans: Spans, loss: FutureLossConfig | None) -> Floats:
    """What the loss of the future asks for; without it measured poses are not needed."""
    rows = int(spans[:, 1].sum())
    if loss is None:
        return np.zeros((rows, 0, 6), np.float32)
    poses = np.concatenate([_load(part.store, part.infos, "tool_pose") for part in parts])
    return look_ahead(poses, spans, loss.horizons)


def _rows(store: EpisodeStore, info: EpisodeInfo, column: str) -> npt.NDArray[np.generic]:
    return store.column(column)[info.start : info.end]


def _load(store: EpisodeStore, infos: Sequence[EpisodeInfo], column: str) -> Floats:
    parts = [_rows(store, info, column).astype(np.float32) for info in infos]
    return _join([*parts, np.empty((0, *store.column(column).shape[1:]), np.float32)])


def _load_images(store: EpisodeStore, infos: Sequence[EpisodeInfo], input_px: int) -> list[Images]:
    """Images of each episode at the size that the network sees."""
    camera = store.spec.camera
    if (camera.height, camera.width) != (CAMERA_PX, CAMERA_PX):
        told = f"images of {camera.height} x {camera.width}"
        expected = f"{CAMERA_PX} x {CAMERA_PX}, as the camera gives them"
        raise BadTrainingData(str(store.folder), told, expected)
    images = np.asarray(store.column("images"), dtype=np.uint8)
    episodes = [images[info.start : info.end] for info in infos]
    return episodes if input_px == CAMERA_PX else _reduce(episodes, input_px)


def _reduce(episodes: Sequence[Images], input_px: int) -> list[Images]:
    """Smaller images of each episode, all in one array: large ones get large memory pages."""
    ends = np.cumsum([len(episode) for episode in episodes])
    out = np.empty((int(ends[-1]) if len(ends) else 0, 2, input_px, input_px), np.uint8)
    smaller = np.split(out, ends[:-1])[: len(episodes)]
    for images, target in zip(episodes, smaller, strict=True):
        for start in range(0, len(images), _REDUCE_ROWS):
            part = slice(start, start + _REDUCE_ROWS)
            target[part] = reduce_images(images[part], input_px=input_px)
    return smaller


def _lead(grasp: npt.NDArray[np.generic], steps: int) -> Floats:
    """g'_k = g_{k + steps}, the last one to the end."""
    early = np.minimum(np.arange(len(grasp)) + steps, len(grasp) - 1)
    return grasp[early].astype(np.float32)


def _weigh(grasp: Floats, network: NetworkConfig) -> Floats:
    """Weights of an episode's steps in the grasp loss."""
    loss = network.loss.grasp or GraspLossConfig()
    weights = compute_grasp_weights(
        torch.from_numpy(grasp),
        transition_weight=loss.transition_weight,
        steps=loss.transition_steps,
    )
    return weights.numpy()


def _spread(count: int, held: int) -> npt.NDArray[np.bool_]:
    """Which of the episodes are held out: evenly spread, so that every data set has its share."""
    chosen = np.zeros(count, np.bool_)
    if held:
        chosen[np.linspace(0, count - 1, held + 2).round().astype(int)[1:-1]] = True
    return chosen


def _join(parts: Sequence[npt.NDArray[Scalar]]) -> npt.NDArray[Scalar]:
    full = [part for part in parts if len(part)]
    return full[0] if len(full) == 1 else np.concatenate(parts)
