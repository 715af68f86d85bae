"""The episode store: demonstrations as columns on disk. See docs/data.md."""

from __future__ import annotations

from common.datasets.index import EpisodeInfo, EpisodeMetadata
from common.datasets.rows import EpisodeRows
from common.datasets.spec import CameraSpec, ColumnSpec, DatasetSpec, Rows
from common.datasets.store import Episode, EpisodeStore
from common.datasets.writer import EpisodeWriter

__all__ = [
    "CameraSpec",
    "ColumnSpec",
    "DatasetSpec",
    "Episode",
    "EpisodeInfo",
    "EpisodeMetadata",
    "EpisodeRows",
    "EpisodeStore",
    "EpisodeWriter",
    "Rows",
]
