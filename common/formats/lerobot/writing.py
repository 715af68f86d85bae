"""A data set as a LeRobotDataset."""

from __future__ import annotations

import json
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from common import __version__
from common.datasets import Episode, EpisodeStore
from common.datasets.errors import NotExportable
from common.formats.labels import Floats, check_exportable, read_eye
from common.formats.lerobot.features import Feature, list_features
from common.formats.lerobot.layout import (
    DATA_FILE,
    DATA_FILE_MB,
    EPISODES_FILE,
    FILES_PER_CHUNK,
    INFO_FILE,
    LEFT_KEY,
    RIGHT_KEY,
    STATISTICS_FILE,
    VERSION,
    VIDEO_FILE,
    VIDEO_FILE_MB,
    FilePlace,
)
from common.formats.lerobot.statistics import (
    LEVELS,
    Histogram,
    Statistics,
    count_levels,
    describe_levels,
    describe_vectors,
)
from common.formats.lerobot.tables import (
    describe_indices,
    make_rows,
    write_records,
    write_table,
    write_tasks,
)
from common.formats.lerobot.videos import Codec, VideoWriter
from common.formats.outputs import new_output
from common.formats.summary import Advance, Summary, be_quiet
from common.tasks import load_task

EYES = (LEFT_KEY, RIGHT_KEY)


def export_lerobot(
    store: EpisodeStore, folder: Path, *, codec: Codec = "av1", advance: Advance = be_quiet
) -> Summary:
    """Write the successful episodes of a data set.

    Args:
        store: The data set.
        folder: To make.
        codec: Of the videos.
        advance: Told after each episode.

    Raises:
        NotExportable: There is nothing to export, or a column is missing.
        UnknownName: There is no such task.
        InvalidValue: There is such a folder, or PyAV was built without this codec.
        MissingExtra: pyarrow or av is not installed.
        NotWritable: The folder cannot be written, or there is no room.
    """
    check_exportable(store)
    good = [episode for episode in store if episode.info.outcome == "success"]
    if not good:
        raise NotExportable(str(store.folder), "no episode succeeded")
    with new_output(folder) as made, _Writer(made, store, codec) as writer:
        for number, episode in enumerate(good):
            writer.append(episode)
            advance(number + 1, len(good))
        writer.finish()
    failed = len(store) - len(good)
    notes = ["videos are lossy: such a data set cannot be imported again"]
    if failed:
        notes.append(f"{failed} failed episodes are left out")
    return Summary(folder, len(good), writer.rows, tuple(notes))


class _Writer(ExitStack):
    """Writes the files as episodes come.

    Args:
        root: Folder to make.
        store: The data set.
        codec: Of the videos.
    """

    def __init__(self, root: Path, store: EpisodeStore, codec: Codec) -> None:
        super().__init__()
        self._root, self._store = root, store
        self._sentence = load_task(store.spec.task).title
        self._fps = _whole_rate(store)
        self._features = list_features(store.spec)
        file_bytes = VIDEO_FILE_MB << 20
        self._videos = {
            key: self.enter_context(
                VideoWriter(root, key, fps=self._fps, codec=codec, file_bytes=file_bytes)
            )
            for key in EYES
        }
        self.rows = 0
        self._data_files = 0
        self._waiting: list[Any] = []
        self._episodes: list[dict[str, Any]] = []
        self._vectors: dict[str, list[Floats]] = {each.key: [] for each in self._features}
        self._levels: dict[str, Histogram] = {key: np.zeros(LEVELS, np.int64) for key in EYES}

    def append(self, episode: Episode) -> None:
        """Write an episode's rows and images, and note where they are."""
        number, place = len(self._episodes), FilePlace(self._data_files)
        record: dict[str, Any] = {
            "episode_index": number,
            "tasks": [self._sentence],
            "length": len(episode),
            "data/chunk_index": place.chunk_index,
            "data/file_index": place.file_index,
            "dataset_from_index": self.rows,
            "dataset_to_index": self.rows + len(episode),
        }
        vectors = {each.key: each.read(episode) for each in self._features}
        statistics = {key: describe_vectors(values) for key, values in vectors.items()}
        for eye, key in enumerate(EYES):
            images = read_eye(episode, eye)
            record |= self._videos[key].append(images)
            histogram = count_levels(images)
            self._levels[key] += histogram
            statistics[key] = describe_levels(histogram, images=len(images))
        record |= {
            f"stats/{key}/{name}": values
            for key, described in statistics.items()
            for name, values in described.items()
        }
        record |= {"meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0}
        self._episodes.append(record)
        self._keep(vectors, number)

    def finish(self) -> None:
        """Write what is known only at the end."""
        self._flush()
        # Closed before they are described: a reader may come as soon as there is `info.json`.
        self.close()
        write_tasks(self._root, [self._sentence])
        write_records(self._root / FilePlace(0).name(EPISODES_FILE), self._episodes)
        _write_json(self._root / STATISTICS_FILE, self._describe_all())
        _write_json(self._root / INFO_FILE, self._describe())

    def _keep(self, vectors: dict[str, Floats], number: int) -> None:
        for key, values in vectors.items():
            self._vectors[key].append(values)
        self._waiting.append(make_rows(vectors, episode=number, first_row=self.rows, fps=self._fps))
        self.rows += len(next(iter(vectors.values())))
        if sum(table.nbytes for table in self._waiting) >= DATA_FILE_MB << 20:
            self._flush()

    def _flush(self) -> None:
        if self._waiting:
            write_table(self._root / FilePlace(self._data_files).name(DATA_FILE), self._waiting)
            self._waiting = []
            self._data_files += 1

    def _describe_all(self) -> dict[str, Statistics]:
        """Statistics over all episodes."""
        vectors = {
            key: describe_vectors(np.concatenate(parts)) for key, parts in self._vectors.items()
        }
        images = {
            key: describe_levels(histogram, images=self.rows)
            for key, histogram in self._levels.items()
        }
        return vectors | images

    def _describe(self) -> dict[str, Any]:
        """The content of `info.json`."""
        return {
            "codebase_version": VERSION,
            "robot_type": self._store.spec.robot,
            "total_episodes": len(self._episodes),
            "total_frames": self.rows,
            "total_tasks": 1,
            "chunks_size": FILES_PER_CHUNK,
            "data_files_size_in_mb": DATA_FILE_MB,
            "video_files_size_in_mb": VIDEO_FILE_MB,
            "fps": self._fps,
            "splits": {"train": f"0:{len(self._episodes)}"},
            "data_path": DATA_FILE,
            "video_path": VIDEO_FILE,
            "features": self._describe_features(self._features),
            "legato": {
                "version": __version__,
                "task": self._store.spec.task,
                "action_convention": self._store.spec.action_convention,
            },
        }

    def _describe_features(self, features: list[Feature]) -> dict[str, Any]:
        camera = self._store.spec.camera
        described = {
            key: {
                "dtype": "video",
                "shape": [camera.height, camera.width, 3],
                "names": ["height", "width", "channels"],
                "info": {
                    "video.height": camera.height,
                    "video.width": camera.width,
                    "video.channels": 3,
                    **self._videos[key].describe(),
                },
            }
            for key in EYES
        }
        return {
            **described,
            **{each.key: each.describe() for each in features},
            **describe_indices(),
        }


def _whole_rate(store: EpisodeStore) -> int:
    """Rows per second, which LeRobot wants as a whole number."""
    rate = round(store.spec.rate_hz)
    if rate < 1 or abs(rate - store.spec.rate_hz) > 1e-9:
        raise NotExportable(str(store.folder), f"{store.spec.rate_hz} rows per second")
    return rate


def _write_json(path: Path, content: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=4, allow_nan=False) + "\n", encoding="utf-8")
