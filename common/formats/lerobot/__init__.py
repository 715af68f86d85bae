"""LeRobotDataset, version 3.0: export only, as its videos are lossy."""

from __future__ import annotations

from common.formats.lerobot.writing import export_lerobot

__all__ = ["export_lerobot"]
