"""One eye's images as videos: episodes one after the other, a new file when one is full."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

import numpy as np

from common.datasets.errors import NotExportable
from common.errors import InvalidValue
from common.formats.labels import Bytes
from common.formats.lerobot.layout import VIDEO_FILE, FilePlace
from common.formats.packages import load_package

Codec = Literal["av1", "h264"]

_ENCODERS = {"av1": "libsvtav1", "h264": "libx264"}
# A key frame every other frame: training reads frames in any order. As lerobot chooses.
_OPTIONS = {
    "av1": {"g": "2", "crf": "30", "preset": "12", "svtav1-params": "lp=1"},
    "h264": {"g": "2", "crf": "23", "threads": "1"},
}
PIXELS = "yuv420p"


class VideoWriter:
    """Appends episodes to the videos of one eye. A context manager.

    Args:
        root: Folder of the LeRobot data set.
        key: Name of the feature.
        fps: Frames per second, a whole number.
        codec: How images are packed; both lose a little.
        file_bytes: A file that has become larger is followed by another.

    Raises:
        MissingExtra: PyAV is not installed.
        InvalidValue: It was built without this codec.
    """

    def __init__(self, root: Path, key: str, *, fps: int, codec: Codec, file_bytes: int) -> None:
        self._av = load_package("av")
        there = [
            name for name, encoder in _ENCODERS.items() if encoder in self._av.codecs_available
        ]
        if codec not in there:
            raise InvalidValue("--codec", codec, f"one that PyAV has here ({', '.join(there)})")
        self._root, self._key = root, key
        self._fps, self._codec, self._file_bytes = fps, codec, file_bytes
        self._number, self._frames, self._bytes = -1, 0, 0
        self._container: Any = None
        self._stream: Any = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._finish()

    def append(self, images: Bytes) -> dict[str, int | float]:
        """Append an episode's (n, height, width) gray images.

        Returns:
            Where they are: columns of the table of episodes.

        Raises:
            NotExportable: The codec cannot take images of this size.
        """
        if self._container is None or self._bytes >= self._file_bytes:
            self._finish()
            self._start(height=images.shape[1], width=images.shape[2])
        first = self._frames
        for image in images:
            frame = self._av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="gray8")
            frame.pts, frame.time_base = self._frames, Fraction(1, self._fps)
            self._mux(frame)
            self._frames += 1
        place = FilePlace(self._number)
        prefix = f"videos/{self._key}"
        return {
            f"{prefix}/chunk_index": place.chunk_index,
            f"{prefix}/file_index": place.file_index,
            f"{prefix}/from_timestamp": first / self._fps,
            f"{prefix}/to_timestamp": self._frames / self._fps,
        }

    def describe(self) -> dict[str, Any]:
        """What `info.json` says of the videos."""
        return {
            "video.fps": self._fps,
            "video.codec": self._codec,
            "video.pix_fmt": PIXELS,
            "video.is_depth_map": False,
            "has_audio": False,
        }

    def _start(self, *, height: int, width: int) -> None:
        if height % 2 or width % 2:
            told = f"images of {height} x {width} are no video: sides have to be even"
            raise NotExportable(str(self._root), told)
        self._number, self._frames, self._bytes = self._number + 1, 0, 0
        place = FilePlace(self._number)
        path = self._root / place.name(VIDEO_FILE, video_key=self._key)
        path.parent.mkdir(parents=True, exist_ok=True)
        self._container = self._av.open(str(path), "w")
        self._stream = self._container.add_stream(
            _ENCODERS[self._codec], rate=self._fps, options=_OPTIONS[self._codec]
        )
        self._stream.pix_fmt = PIXELS
        self._stream.height, self._stream.width = height, width
        self._stream.time_base = Fraction(1, self._fps)

    def _finish(self) -> None:
        if self._container is None:
            return
        self._mux(None)
        self._container.close()
        self._container = None

    def _mux(self, frame: Any) -> None:
        """Encode a frame, or what the encoder still holds, and write it."""
        for packet in self._stream.encode(frame):
            self._bytes += packet.size
            self._container.mux(packet)
