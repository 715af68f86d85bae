"""The keys that count now."""

from __future__ import annotations

import logging
from pathlib import Path

from common.errors import BadKeyFile
from common.keys import ApiKey, KeyFile, read_keys

log = logging.getLogger(__name__)


class KeyRing:
    """The keys of a file, read again whenever it changes: a revoked key is refused at once.

    A file that cannot be read any more lets nobody in; the log says why.

    Args:
        path: The file.

    Raises:
        BadKeyFile: There is none, or it is not one of keys.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._stamp = self._read_stamp()
        self._file = read_keys(path)

    def find(self, key: str) -> ApiKey | None:
        """The entry of a key, or None when it does not count."""
        stamp = self._read_stamp()
        if stamp != self._stamp:
            self._stamp = stamp
            self._read()
        return self._file.find(key)

    def _read(self) -> None:
        try:
            self._file = read_keys(self._path)
            log.info("keys read", extra={"keys": [key.name for key in self._file.keys]})
        except BadKeyFile as error:
            self._file = KeyFile()
            log.error("nobody is let in", extra=error.describe())

    def _read_stamp(self) -> tuple[int, int, int] | None:
        try:
            found = self._path.stat()
        except OSError:
            return None
        return found.st_mtime_ns, found.st_ino, found.st_size
