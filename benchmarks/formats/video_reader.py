"""`torchvision.io.VideoReader`, which lerobot 0.4 reads videos with, by PyAV.

torchvision has dropped it since. lerobot's other way is torchcodec, which needs FFmpeg as a system
package, while PyAV brings its own.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import av
import torch
import torchvision


class VideoReader:
    """Frames of a video from a time on, with the times at which they are shown."""

    def __init__(self, path: str, stream: str) -> None:
        if stream != "video":
            raise ValueError(f"stream {stream}")
        self.container = av.open(path)
        self._stream = self.container.streams.video[0]

    def seek(self, time_s: float, *, keyframes_only: bool) -> None:
        """Go to the key frame at or before a time."""
        if not keyframes_only:
            raise ValueError("PyAV seeks key frames only")
        self.container.seek(int(time_s / self._stream.time_base), stream=self._stream)

    def __iter__(self) -> Iterator[dict[str, Any]]:
        for frame in self.container.decode(self._stream):
            pixels = torch.from_numpy(frame.to_ndarray(format="rgb24"))
            yield {"data": pixels.permute(2, 0, 1), "pts": float(frame.pts * frame.time_base)}


def install() -> None:
    """Put it where lerobot looks for it, unless torchvision still has its own."""
    if not hasattr(torchvision.io, "VideoReader"):
        torchvision.io.VideoReader = VideoReader
        torchvision.set_video_backend = lambda name: None
