"""Small recordings, and robomimic files as others write them."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from common.datasets import EpisodeMetadata, EpisodeRows, EpisodeStore, EpisodeWriter
from services.recorder.columns import describe_dataset
from tests.training_data import make_rows

SIZE_PX = 128


def draw_images(rows: int, *, seed: int) -> np.ndarray:
    """Smooth (rows, 2, 128, 128) gray images that move, different for the two eyes."""
    row, column = np.mgrid[:SIZE_PX, :SIZE_PX] / SIZE_PX
    phase = np.arange(rows)[:, None, None, None] / 10 + np.array([0.0, 1.0])[:, None, None] + seed
    waves = np.sin(3.0 * row + 5.0 * column * column + phase)
    return np.rint(127.5 + 120.0 * waves).astype(np.uint8)


def write_recording(
    folder: Path,
    lengths: tuple[int, ...] = (6, 9),
    *,
    failed: tuple[int, ...] = (),
    without: tuple[str, ...] = (),
) -> EpisodeStore:
    """A recording of the lid task; `without` names columns that it does not have."""
    spec = describe_dataset(
        task="lid", robot="abstract", camera="t265", recording={"seed": 3}, software={"legato": "1"}
    )
    columns = tuple(column for column in spec.columns if column.name not in without)
    spec = spec.model_copy(update={"columns": columns})
    names = {column.name for column in columns}
    with EpisodeWriter.open(folder, spec) as writer:
        for number, length in enumerate(lengths):
            rows = dict(make_rows(spec, length, seed=number).columns)
            rows["images"] = draw_images(length, seed=number)
            rows["action"][-1] = 0.0
            metadata = EpisodeMetadata(
                trial=number,
                seed=100 + number,
                outcome="failure" if number in failed else "success",
                details={"reason": "ok", "idle_rows_dropped": 2},
            )
            kept = {name: values for name, values in rows.items() if name in names}
            writer.append(EpisodeRows(kept), metadata)
    return EpisodeStore.open(folder)


def make_foreign_demo(rows: int, *, seed: int = 0, idle: int = 0) -> dict[str, np.ndarray]:
    """What a robomimic file of others has of a demonstration, by path."""
    random = np.random.default_rng(seed)
    actions = random.uniform(-0.3, 0.3, (rows, 7)).astype(np.float32)
    actions[:, 6] = np.arange(rows) >= rows // 2
    actions[:idle] = 0.0
    actions[-1, :6] = 0.0
    images = draw_images(rows, seed=seed)[..., None]
    return {
        "actions": actions,
        "dones": np.zeros(rows, np.uint8),
        "rewards": np.zeros(rows, np.float32),
        "obs/left_gray": images[:, 0],
        "obs/right_gray": images[:, 1],
        "obs/delta_positions": random.normal(size=(rows, 6)).astype(np.float32),
    }


def write_foreign(path: Path, demos: list[dict[str, np.ndarray]]) -> Path:
    """A robomimic file."""
    with h5py.File(path, "w") as file:
        for number, demo in enumerate(demos):
            group = file.create_group(f"data/demo_{number}")
            group.attrs["num_samples"] = len(demo["actions"])
            for key, values in demo.items():
                group[key] = values
    return path
