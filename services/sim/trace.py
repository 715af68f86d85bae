"""A fingerprint of an episode: every state, command and image, bit for bit."""

from __future__ import annotations

import hashlib
from array import array
from collections.abc import Sequence


class Trace:
    """SHA-256 over all that decided an episode, in the order it happened.

    Two runs with equal hashes went through the same states with the same commands and images.
    Wall-clock times, names of nodes and sequence numbers are not part of it.
    """

    def __init__(self) -> None:
        self._hash = hashlib.sha256()

    def add_numbers(self, label: bytes, values: Sequence[float]) -> None:
        """Add floats, IEEE 754 doubles as they lie in memory."""
        self._hash.update(label)
        self._hash.update(array("d", values).tobytes())

    def add_bytes(self, label: bytes, *buffers: bytes | memoryview) -> None:
        """Add an image or other contiguous memory."""
        self._hash.update(label)
        for buffer in buffers:
            self._hash.update(buffer)

    def hexdigest(self) -> str:
        """The fingerprint so far, 64 hexadecimal digits."""
        return self._hash.hexdigest()
