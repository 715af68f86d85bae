"""A data set as a file that robomimic trains on."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from common import __version__
from common.datasets import DatasetSpec, Episode, EpisodeStore
from common.datasets.spec import IMAGES
from common.formats.labels import (
    Floats,
    check_exportable,
    label_column,
    list_history,
    read_eye,
    read_labels,
    spread,
)
from common.formats.outputs import new_output
from common.formats.packages import load_package
from common.formats.robomimic.layout import (
    COLUMNS,
    EPISODE_ATTRIBUTE,
    LEFT,
    OFFSET_ATTRIBUTE,
    RIGHT,
    SCALE_ATTRIBUTE,
    SPEC_ATTRIBUTE,
    ActionCoding,
)
from common.formats.rotations import quaternions_from_vectors, rpy_from_vectors
from common.formats.summary import Advance, Summary, be_quiet

VALID_SHARE = 0.1
_NOT_OBSERVED = (IMAGES, "action", "intended", "grasp", "frame_step", "state_step")
_GYM_TYPE = 2


def export_robomimic(
    store: EpisodeStore,
    path: Path,
    *,
    channels: Literal[1, 3] = 3,
    advance: Advance = be_quiet,
) -> Summary:
    """Write all episodes of a data set.

    Args:
        store: The data set.
        path: File to write.
        channels: 3 repeats the gray level, as robomimic's own kind of image asks for; 1 needs a
            kind of image of your own.
        advance: Told after each episode.

    Raises:
        NotExportable: There is nothing to export, or a column is missing.
        InvalidValue: There is such a file.
        MissingExtra: h5py is not installed.
        NotWritable: The file cannot be written, or there is no room.
    """
    h5py = load_package("h5py")
    check_exportable(store)
    coding = ActionCoding.fit(read_labels(episode, store.spec) for episode in store)
    with new_output(path) as made, h5py.File(made, "w", libver="latest") as file:
        data = file.create_group("data")
        data.attrs.update(_describe(store, coding))
        for number, episode in enumerate(store):
            demo = data.create_group(f"demo_{number}")
            _write_demo(demo, episode, store.spec, coding=coding, channels=channels)
            advance(number + 1, len(store))
        failed = _write_masks(file, store)
    notes = (f"{failed} failed episodes are in the file and in mask/failed",) if failed else ()
    return Summary(path, len(store), store.rows, notes)


def _describe(store: EpisodeStore, coding: ActionCoding) -> dict[str, Any]:
    """Attributes of the group `data`."""
    spec = store.spec
    environment = {
        "env_name": f"legato-{spec.task}",
        # robomimic knows only its own kinds; it looks at this when it is to run the environment.
        "type": _GYM_TYPE,
        "env_kwargs": {"task": spec.task, "robot": spec.robot},
    }
    return {
        "total": store.rows,
        "env_args": json.dumps(environment),
        SCALE_ATTRIBUTE: coding.scale,
        OFFSET_ATTRIBUTE: coding.offset,
        "action_convention": f"{label_column(spec)}: {spec.action_convention}; then grasp, "
        "1 = close; action = action_scale * stored + action_offset",
        "quaternions": "wxyz",
        SPEC_ATTRIBUTE: spec.model_dump_json(),
        "legato_version": __version__,
    }


def _write_demo(
    demo: Any, episode: Episode, spec: DatasetSpec, *, coding: ActionCoding, channels: int
) -> None:
    """Write one episode into its group."""
    rows = len(episode)
    demo.attrs["num_samples"] = rows
    demo.attrs[EPISODE_ATTRIBUTE] = episode.info.model_dump_json()
    demo["actions"] = coding.encode(read_labels(episode, spec))
    last = (np.arange(rows) == rows - 1).astype(np.uint8)
    demo["dones"] = last
    demo["rewards"] = last.astype(np.float32) * float(episode.info.outcome == "success")
    observed = demo.create_group("obs")
    for eye, name in enumerate((LEFT, RIGHT)):
        _write_images(observed, name, read_eye(episode, eye)[..., None], channels)
    for name, values in _list_observed(episode, spec).items():
        observed[name] = values.astype(np.float32)
    kept = demo.create_group(COLUMNS)
    for column in spec.columns:
        if column.name != IMAGES:
            kept[column.name] = episode[column.name]


def _write_images(group: Any, name: str, gray: np.ndarray[Any, Any], channels: int) -> None:
    """One chunk per image: repeated channels pack to nothing, and any image is read alone."""
    images = np.repeat(gray, channels, axis=-1)
    chunk = (1, *images.shape[1:])
    group.create_dataset(name, data=images, chunks=chunk, compression="gzip", compression_opts=1)


def _list_observed(episode: Episode, spec: DatasetSpec) -> dict[str, Floats]:
    """Observations beside the images, (n, k) each."""
    rows = len(episode)
    past = list_history(episode["action"].astype(np.float64))
    turns = past[..., 3:].reshape(-1, 3)
    observed = {
        "delta_positions": past[..., :3].reshape(rows, -1),
        "delta_eulers": rpy_from_vectors(turns).reshape(rows, -1),
        "delta_quaternions": quaternions_from_vectors(turns).reshape(rows, -1),
    }
    for column in spec.columns:
        if column.name not in _NOT_OBSERVED and not column.privileged:
            observed[column.name] = episode[column.name].astype(np.float64).reshape(rows, -1)
    return observed


def _write_masks(file: Any, store: EpisodeStore) -> int:
    """Which demos are for training, for validation, and failed; how many failed."""
    good = [n for n, info in enumerate(store.episodes) if info.outcome == "success"]
    failed = [n for n, info in enumerate(store.episodes) if info.outcome == "failure"]
    held = {good[place] for place in spread(len(good), round(VALID_SHARE * len(good)))}
    _write_mask(file, "train", [number for number in good if number not in held])
    _write_mask(file, "valid", sorted(held))
    if failed:
        _write_mask(file, "failed", failed)
    return len(failed)


def _write_mask(file: Any, name: str, numbers: Sequence[int]) -> None:
    file[f"mask/{name}"] = np.array([f"demo_{number}".encode() for number in numbers], dtype="S16")
