"""Windows of consecutive frames, drawn without any state: update u of a seed is always the same.

An episode of n rows has windows that start at clip(s, 0, n - T), s uniform over
-T/2 .. n - T/2: so its first and last frames are seen as often as those in the middle.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from services.policy.learning.config import NetworkConfig
from services.policy.learning.images import CAMERA_PX, Images
from services.policy.learning.losses import Targets
from services.policy.training.config import AugmentationConfig, TrainingConfig
from services.policy.training.data import Floats, Spans, TrainingData

Indices = npt.NDArray[np.int64]

_DEFAULT_LOSS_HISTORY = 2


@dataclass(frozen=True)
class WindowBatch:
    """What one forward pass needs.

    Args:
        images: (B, T, 2, px, px) uint8.
        history: (B, T, history steps, 6) [m, rad] executed actions before each step.
        targets: What is to be said.
    """

    images: Tensor
    history: Tensor
    targets: Targets

    def to(self, device: torch.device) -> WindowBatch:
        """The same on a device."""
        targets = self.targets
        return WindowBatch(
            images=self.images.to(device, non_blocking=True),
            history=self.history.to(device, non_blocking=True),
            targets=Targets(
                actions=targets.actions.to(device, non_blocking=True),
                grasp=targets.grasp.to(device, non_blocking=True),
                grasp_weight=targets.grasp_weight.to(device, non_blocking=True),
                history=targets.history.to(device, non_blocking=True),
                future=(
                    None if targets.future is None else targets.future.to(device, non_blocking=True)
                ),
            ),
        )


class WindowLoader:
    """Batches of windows.

    Args:
        data: In memory.
        config: Of the run.
        rank: Which share of each batch this process takes.
        world_size: Number of shares.
    """

    def __init__(
        self, data: TrainingData, config: TrainingConfig, *, rank: int = 0, world_size: int = 1
    ) -> None:
        self._data = data
        self._config = config
        self._window = config.network.window
        self._share = (rank, world_size)
        starts, lengths = data.spans[:, 0], data.spans[:, 1]
        self._ends = np.cumsum(lengths + 1)
        self._starts, self._lengths = starts, lengths
        loss_steps = _loss_history(config.network)
        steps = max(config.network.history.steps, loss_steps)
        self._past = _list_history(data, steps)
        self._history_steps, self._loss_steps = config.network.history.steps, loss_steps

    def batch(self, update: int) -> WindowBatch:
        """This process's share of the batch of an update, varied as the config says."""
        random = np.random.default_rng([self._config.seed, update])
        rows = self.draw(random, self._config.batch_windows)
        shifts = draw_shifts(random, len(rows), self._config)
        gains = draw_gains(random, len(rows), self._config.augmentation)
        rank, world_size = self._share
        mine = slice(rank, None, world_size)
        batch = self.gather(rows[mine], shifts[mine])
        return WindowBatch(vary_gray(batch.images, gains[mine]), batch.history, batch.targets)

    def draw(self, random: np.random.Generator, count: int) -> Indices:
        """(count,) first rows of windows."""
        drawn = random.integers(0, self._ends[-1], size=count)
        episode = np.searchsorted(self._ends, drawn, side="right")
        length = self._lengths[episode]
        offset = drawn - (self._ends[episode] - (length + 1)) - self._window // 2
        return self._starts[episode] + np.clip(offset, 0, length - self._window)

    def gather(self, rows: Indices, shifts: Indices | None = None) -> WindowBatch:
        """Windows by their first rows.

        Args:
            rows: (B,) first rows.
            shifts: (B, 2) pixels by which images move down and right; None = not at all.
        """
        index = rows[:, None] + np.arange(self._window)
        data, past = self._data, self._past[index]
        images = _gather_images(data.images, rows, self._window, shifts)
        return WindowBatch(
            images=torch.from_numpy(images),
            history=torch.from_numpy(past[:, :, past.shape[2] - self._history_steps :]),
            targets=Targets(
                actions=torch.from_numpy(data.actions[index]),
                grasp=torch.from_numpy(data.grasp[index]),
                grasp_weight=torch.from_numpy(data.grasp_weight[index]),
                history=torch.from_numpy(past[:, :, past.shape[2] - self._loss_steps :]),
                future=torch.from_numpy(data.future[index]),
            ),
        )

    def validation(self) -> Iterator[WindowBatch]:
        """Held-out windows side by side, in batches; without any variation."""
        rows = list_windows(self._data.validation, self._window)
        for start in range(0, len(rows), self._config.batch_windows):
            yield self.gather(rows[start : start + self._config.batch_windows])


def open_frames(
    data: TrainingData, config: TrainingConfig, *, rank: int, world_size: int
) -> WindowLoader:
    """Windows of a single frame for the encoders, in the batches of the pretraining."""
    network = config.network.model_copy(update={"window": 1})
    changes: dict[str, object] = {"network": network}
    if config.pretraining is not None:
        changes["batch_windows"] = config.pretraining.batch_frames
    single = config.model_copy(update=changes)
    return WindowLoader(data, single, rank=rank, world_size=world_size)


def list_windows(spans: Spans, window: int) -> Indices:
    """First rows of windows that cover each episode once; the last one may overlap."""
    rows = [
        row
        for start, length in spans.tolist()
        for row in (*range(start, start + length - window, window), start + length - window)
    ]
    return np.array(rows, np.int64)


def draw_shifts(random: np.random.Generator, count: int, config: TrainingConfig) -> Indices:
    """(count, 2) shifts in pixels of the network's images."""
    scale = CAMERA_PX // config.network.encoder.input_px
    largest = config.augmentation.shift_px // scale
    return random.integers(-largest, largest + 1, size=(count, 2))


def draw_gains(random: np.random.Generator, count: int, config: AugmentationConfig) -> Floats:
    """(count, 2) contrast factor and brightness offset [gray levels]."""
    contrast = 1.0 + config.contrast * random.uniform(-1.0, 1.0, size=count)
    brightness = 255.0 * config.brightness * random.uniform(-1.0, 1.0, size=count)
    return np.stack([contrast, brightness], axis=1).astype(np.float32)


def vary_gray(images: Tensor, gains: Floats) -> Tensor:
    """I' = clip(c (I - 127.5) + 127.5 + b) of each window, by table, so that bytes stay bytes."""
    levels = np.arange(256, dtype=np.float32)
    tables = gains[:, :1] * (levels - 127.5) + 127.5 + gains[:, 1:]
    tables = np.clip(np.rint(tables), 0, 255).astype(np.uint8)
    out = images.numpy()
    for window, table in zip(out, tables, strict=True):
        np.take(table, window, out=window, mode="clip")
    return images


def _loss_history(network: NetworkConfig) -> int:
    invariant = network.loss.invariant
    return _DEFAULT_LOSS_HISTORY if invariant is None else invariant.history_steps


def _list_history(data: TrainingData, steps: int) -> Floats:
    """(rows, steps, 6) executed actions before each row, oldest first, zero before the start."""
    past = np.zeros((len(data.executed), steps, 6), np.float32)
    for start, length in (*data.spans.tolist(), *data.validation.tolist()):
        for back in range(1, steps + 1):
            past[start + back : start + length, steps - back] = data.executed[
                start : start + length - back
            ]
    return past


def _gather_images(images: Images, rows: Indices, window: int, shifts: Indices | None) -> Images:
    """(B, T, 2, px, px) copies; what a shift uncovers repeats the edge."""
    out = np.empty((len(rows), window, *images.shape[1:]), np.uint8)
    if shifts is None:
        for copy, row in zip(out, rows.tolist(), strict=True):
            copy[...] = images[row : row + window]
        return out
    for copy, row, (down, right) in zip(out, rows.tolist(), shifts.tolist(), strict=True):
        _shift(images[row : row + window], copy, down, right)
    return out


def _shift(source: Images, target: Images, down: int, right: int) -> None:
    """target[..., i, j] = source[..., clip(i - down), clip(j - right)]."""
    px = source.shape[-1]
    top, left = max(down, 0), max(right, 0)
    bottom, end = px + min(down, 0), px + min(right, 0)
    inner = source[..., top - down : bottom - down, left - right : end - right]
    target[..., top:bottom, left:end] = inner
    target[..., top:bottom, :left] = inner[..., :1]
    target[..., top:bottom, end:] = inner[..., -1:]
    target[..., :top, :] = target[..., top : top + 1, :]
    target[..., bottom:, :] = target[..., bottom - 1 : bottom, :]
