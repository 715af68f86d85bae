"""One episode as arrays, before it is written."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from common.datasets.errors import BadEpisode
from common.datasets.spec import DatasetSpec, Rows


@dataclass(frozen=True)
class EpisodeRows:
    """The rows of one episode.

    Args:
        columns: Name -> values (n, *shape of a row), n the same for all.
    """

    columns: Mapping[str, Rows]

    def __len__(self) -> int:
        return min((len(values) for values in self.columns.values()), default=0)

    def checked(self, spec: DatasetSpec) -> list[Rows]:
        """Its columns in the order of the data set, contiguous and ready to be written.

        Raises:
            BadEpisode: A column is missing, unknown, or of another type, shape or length, has no
                rows, or a number that is not finite.
        """
        names = [column.name for column in spec.columns]
        for name in self.columns:
            if name not in names:
                raise BadEpisode(name, "is unknown", f"one of {', '.join(names)}")
        length, ready = len(self), list[Rows]()
        for column in spec.columns:
            values = self.columns.get(column.name)
            if values is None:
                raise BadEpisode(column.name, "is missing", "every column of the data set")
            if values.dtype != column.numpy_dtype:
                raise BadEpisode(column.name, f"is {values.dtype}", column.dtype)
            if values.shape[1:] != column.shape:
                shape = list(values.shape[1:])
                raise BadEpisode(column.name, f"has rows of {shape}", f"{list(column.shape)}")
            if len(values) != length or length == 0:
                raise BadEpisode(column.name, f"has {len(values)} rows", f"{max(length, 1)}")
            if column.dtype in ("f32", "f64") and not np.isfinite(values).all():
                raise BadEpisode(column.name, "has a value that is not a number", "finite numbers")
            ready.append(np.ascontiguousarray(values))
        return ready


def hash_rows(columns: Iterable[Rows]) -> str:
    """SHA-256 of an episode: the bytes of its columns, one after the other."""
    digest = hashlib.sha256()
    for values in columns:
        digest.update(np.ascontiguousarray(values).data)
    return digest.hexdigest()
