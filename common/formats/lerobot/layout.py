"""Where what is, and under which names. Source: lerobot 0.4.4, `lerobot/datasets`."""

from __future__ import annotations

from dataclasses import dataclass

VERSION = "v3.0"
LEFT_KEY, RIGHT_KEY = "observation.images.left", "observation.images.right"
ACTION_KEY, STATE_KEY, EXECUTED_KEY = "action", "observation.state", "executed_action"

FILES_PER_CHUNK = 1000
DATA_FILE_MB = 100
VIDEO_FILE_MB = 200

INFO_FILE = "meta/info.json"
STATISTICS_FILE = "meta/stats.json"
TASKS_FILE = "meta/tasks.parquet"
FILE_NAME = "chunk-{chunk_index:03d}/file-{file_index:03d}"
EPISODES_FILE = f"meta/episodes/{FILE_NAME}.parquet"
DATA_FILE = f"data/{FILE_NAME}.parquet"
VIDEO_FILE = f"videos/{{video_key}}/{FILE_NAME}.mp4"

MOTION_NAMES = ("dx_m", "dy_m", "dz_m", "rx_rad", "ry_rad", "rz_rad")


@dataclass(frozen=True)
class FilePlace:
    """Which of the numbered files of a kind."""

    number: int

    @property
    def chunk_index(self) -> int:
        """Number of its folder."""
        return self.number // FILES_PER_CHUNK

    @property
    def file_index(self) -> int:
        """Its number there."""
        return self.number % FILES_PER_CHUNK

    def name(self, pattern: str, **others: str) -> str:
        """Its path by a pattern of this module."""
        return pattern.format(chunk_index=self.chunk_index, file_index=self.file_index, **others)
