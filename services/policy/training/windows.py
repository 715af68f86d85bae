"""Windows of consecutive frames, drawn without any state: update u of a seed is always the same.

An episode of n rows has windows that start at clip(s, 0, n - T), s uniform over
-T/2 .. n - T/2: so its first and last frames are seen as often as those in the middle.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import accumulate, pairwise

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from common.errors import InvalidValue
from services.policy.learning.config import NetworkConfig
from services.policy.learning.images import Images
from services.policy.learning.losses import Targets
from services.policy.learning.network import POSE_DIMS
from services.policy.training.config import TrainingConfig
from services.policy.training.data import Floats, Spans, TrainingData
from services.policy.training.variation import Variations, draw_variations, vary

Indices = npt.NDArray[np.int64]

_DEFAULT_LOSS_HISTORY = 2
_DRAWN_TOGETHER = 64
"""Updates whose windows are drawn at once: seeding a generator takes as long as filling a batch."""


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

    The images of a batch are overwritten by the next one of the same loader: memory that is new to
    the process costs more than filling it.

    Args:
        data: What is loaded.
        config: Of the run.
        rank: Which share of each batch this process takes.
        world_size: Number of shares.
        threads: Among which the windows of a batch are shared; they do not change what is loaded.

    Raises:
        InvalidValue: The windows of a batch cannot be shared equally.
    """

    def __init__(
        self,
        data: TrainingData,
        config: TrainingConfig,
        *,
        rank: int = 0,
        world_size: int = 1,
        threads: int = 1,
    ) -> None:
        if config.batch_windows % world_size:
            expected = f"a multiple of {world_size}, the number of processes"
            raise InvalidValue("windows per batch", config.batch_windows, expected)
        self._frames, self._validation = data.frames, data.validation
        self._config, self._share = config, (rank, world_size)
        self._window = config.network.window
        self._starts, self._lengths = data.spans[:, 0], data.spans[:, 1]
        self._ends = np.cumsum(self._lengths + 1)
        self._columns = _Columns.of(data, config.network)
        self._memory = np.empty((0, self._window, 2, data.frames.px, data.frames.px), np.uint8)
        self._drawn = (-1, np.empty((0, 0), np.int64), np.empty((0, 0, 0), np.int64))
        # One share is done by whoever asks.
        self._threads = threads
        self._pool = ThreadPoolExecutor(threads - 1, "loader") if threads > 1 else None

    def batch(self, update: int) -> WindowBatch:
        """This process's share of the batch of an update, varied as the config says."""
        block, number = divmod(update, _DRAWN_TOGETHER)
        if self._drawn[0] != block:
            self._drawn = (block, *self._draw_block(block))
        rank, world_size = self._share
        _, rows, variations = self._drawn
        mine = slice(rank, None, world_size)
        return self.gather(rows[number, mine], variations[number, mine])

    def _draw_block(self, block: int) -> tuple[Indices, Variations]:
        """(updates, B) first rows and (updates, B, 4) variations of the windows of some updates."""
        random = np.random.default_rng([self._config.seed, block])
        shape = (_DRAWN_TOGETHER, self._config.batch_windows)
        rows = self.draw(random, math.prod(shape))
        variations = draw_variations(random, len(rows), self._config)
        return rows.reshape(shape), variations.reshape((*shape, 4))

    def draw(self, random: np.random.Generator, count: int) -> Indices:
        """(count,) first rows of windows."""
        drawn = random.integers(0, self._ends[-1], size=count)
        episode = np.searchsorted(self._ends, drawn, side="right")
        length = self._lengths[episode]
        offset = drawn - (self._ends[episode] - (length + 1)) - self._window // 2
        return self._starts[episode] + np.clip(offset, 0, length - self._window)

    def gather(self, rows: Indices, variations: Variations | None = None) -> WindowBatch:
        """Windows by their first rows.

        Args:
            rows: (B,) first rows.
            variations: (B, 4) of their images; None = as they are.
        """
        index = rows[:, None] + np.arange(self._window)
        images = self._gather_images(rows, variations)
        return self._columns.gather(index, torch.from_numpy(images))

    def _gather_images(self, rows: Indices, variations: Variations | None) -> Images:
        """(B, T, 2, px, px) in the loader's own memory."""
        if len(rows) > len(self._memory):
            self._memory = np.empty((len(rows), *self._memory.shape[1:]), np.uint8)
        images = self._memory[: len(rows)]
        how = [None] * len(rows) if variations is None else variations.tolist()
        windows = self._frames.windows(rows, self._window)
        work = list(zip(windows, images, how, strict=True))
        if self._pool is None:
            _copy_windows(work)
            return images
        shares = [work[first :: self._threads] for first in range(self._threads)]
        others = [self._pool.submit(_copy_windows, share) for share in shares[1:]]
        _copy_windows(shares[0])
        for other in others:
            other.result()
        return images

    def validation(self) -> Iterator[WindowBatch]:
        """Held-out windows side by side, in batches; without any variation."""
        rows = list_windows(self._validation, self._window)
        for start in range(0, len(rows), self._config.batch_windows):
            yield self.gather(rows[start : start + self._config.batch_windows])


def _copy_windows(work: Iterable[tuple[Images, Images, list[int] | None]]) -> None:
    """From where they are to where they go, varied as is said."""
    for window, copy, variation in work:
        if variation is None:
            copy[...] = window
        else:
            vary(window, copy, *variation)


def open_frames(
    data: TrainingData, config: TrainingConfig, *, rank: int, world_size: int, threads: int = 1
) -> WindowLoader:
    """Windows of a single frame for the encoders, in the batches of the pretraining."""
    network = config.network.model_copy(update={"window": 1})
    changes: dict[str, object] = {"network": network}
    if config.pretraining is not None:
        changes["batch_windows"] = config.pretraining.batch_frames
    single = config.model_copy(update=changes)
    return WindowLoader(data, single, rank=rank, world_size=world_size, threads=threads)


def list_windows(spans: Spans, window: int) -> Indices:
    """First rows of windows that cover each episode once; the last one may overlap."""
    rows = [
        row
        for start, length in spans.tolist()
        for row in (*range(start, start + length - window, window), start + length - window)
    ]
    return np.array(rows, np.int64)


@dataclass(frozen=True)
class _Columns:
    """All numbers of a row side by side, so that a batch takes them in one go.

    Args:
        table: (rows, values) float32: actions, grasp, its weight, history, future.
        bounds: First column of each of these, and the number of columns.
        horizons: Times of which the future speaks.
        history_steps: Past actions that the network sees.
        loss_steps: Past actions that the loss sees.
    """

    table: Floats
    bounds: tuple[int, ...]
    horizons: int
    history_steps: int
    loss_steps: int

    @classmethod
    def of(cls, data: TrainingData, network: NetworkConfig) -> _Columns:
        """Those of a data set, with the histories that a network asks for."""
        invariant = network.loss.invariant
        history_steps = network.history.steps
        loss_steps = _DEFAULT_LOSS_HISTORY if invariant is None else invariant.history_steps
        past = _list_history(data, max(history_steps, loss_steps))
        columns = (data.actions, data.grasp, data.grasp_weight, past, data.future)
        parts = [column.reshape(len(column), -1) for column in columns]
        return cls(
            table=np.concatenate(parts, axis=1),
            bounds=tuple(accumulate((part.shape[1] for part in parts), initial=0)),
            horizons=data.future.shape[1],
            history_steps=history_steps,
            loss_steps=loss_steps,
        )

    def gather(self, index: Indices, images: Tensor) -> WindowBatch:
        """Rows (B, T) with their images."""
        # Cut up by numpy, which takes a tenth of the time that torch does.
        taken = self.table.take(index, axis=0)
        parts = (taken[..., start:end] for start, end in pairwise(self.bounds))
        actions, grasp, weight, flat_past, flat_future = parts
        past = flat_past.reshape(*index.shape, -1, POSE_DIMS)
        steps = past.shape[2]
        return WindowBatch(
            images=images,
            history=torch.from_numpy(past[:, :, steps - self.history_steps :]),
            targets=Targets(
                actions=torch.from_numpy(actions),
                grasp=torch.from_numpy(grasp[..., 0]),
                grasp_weight=torch.from_numpy(weight[..., 0]),
                history=torch.from_numpy(past[:, :, steps - self.loss_steps :]),
                future=torch.from_numpy(
                    flat_future.reshape(*index.shape, self.horizons, POSE_DIMS)
                ),
            ),
        )


def _list_history(data: TrainingData, steps: int) -> Floats:
    """(rows, steps, 6) executed actions before each row, oldest first, zero before the start."""
    past = np.zeros((len(data.executed), steps, 6), np.float32)
    for start, length in (*data.spans.tolist(), *data.validation.tolist()):
        for back in range(1, steps + 1):
            past[start + back : start + length, steps - back] = data.executed[
                start : start + length - back
            ]
    return past
