"""A file that LEGATO exported: the data set it was made of, bit for bit."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TypeVar

import numpy as np
from pydantic import BaseModel, ValidationError

from common.datasets import DatasetSpec, EpisodeInfo, EpisodeMetadata, EpisodeRows, Rows
from common.datasets.errors import BadForeignFile
from common.datasets.rows import hash_rows
from common.datasets.spec import IMAGES
from common.errors import InvalidValue
from common.formats.labels import label_column
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
from common.formats.robomimic.options import ImportOptions
from common.formats.robomimic.source import Demo

_Model = TypeVar("_Model", bound=BaseModel)
_EDITED = "what `legato data export` wrote; edited files are not restored"


class OwnFile:
    """The episodes of an export.

    Args:
        path: Of the file.
        data: Its group `data`.
        options: Only task and robot may be given, and have to agree.

    Raises:
        BadForeignFile: Its description is damaged.
        InvalidValue: An option that contradicts the file, or that it leaves no choice for.
    """

    notes = ("restored bit for bit: every episode has the hash that it had",)

    def __init__(self, path: str, data: Any, options: ImportOptions) -> None:
        self._path = path
        self.spec = self._parse(DatasetSpec, data.attrs[SPEC_ATTRIBUTE])
        self._refuse(options)
        scale, offset = data.attrs.get(SCALE_ATTRIBUTE), data.attrs.get(OFFSET_ATTRIBUTE)
        if scale is None or offset is None:
            raise BadForeignFile(path, "data has no scale of actions", _EDITED)
        self._coding = ActionCoding(np.asarray(scale), np.asarray(offset))

    def convert(self, demo: Demo) -> tuple[EpisodeRows, EpisodeMetadata]:
        """The episode of a demonstration.

        Raises:
            BadForeignFile: It is not what was exported.
        """
        info = self._parse(EpisodeInfo, demo.group.attrs.get(EPISODE_ATTRIBUTE, "null"))
        rows = EpisodeRows(dict(self._read_columns(demo)))
        ordered = rows.checked(self.spec)
        if hash_rows(ordered) != info.sha256:
            raise demo.wrong("differs from the episode that was exported", _EDITED)
        labels = np.concatenate(
            [
                rows.columns[label_column(self.spec)].astype(np.float64),
                rows.columns["grasp"].astype(np.float64)[:, None],
            ],
            axis=1,
        )
        if not np.array_equal(demo.read("actions"), self._coding.encode(labels)):
            raise demo.wrong("actions are not those of the columns", _EDITED)
        return rows, EpisodeMetadata.model_validate(
            info.model_dump(include=set(EpisodeMetadata.model_fields))
        )

    def _read_columns(self, demo: Demo) -> Iterator[tuple[str, Rows]]:
        height, width = self.spec.camera.height, self.spec.camera.width
        for column in self.spec.columns:
            if column.name == IMAGES:
                eyes = [
                    demo.read_gray(f"obs/{name}", height=height, width=width)
                    for name in (LEFT, RIGHT)
                ]
                yield IMAGES, np.stack(eyes, axis=1)
            else:
                yield column.name, demo.read(f"{COLUMNS}/{column.name}")

    def _parse(self, kind: type[_Model], text: str) -> _Model:
        try:
            return kind.model_validate_json(text)
        except ValidationError as error:
            raise BadForeignFile(self._path, f"no valid {kind.__name__} in it", _EDITED) from error

    def _refuse(self, options: ImportOptions) -> None:
        said = {"task": self.spec.task, "robot": self.spec.robot}
        for name, value in options.given().items():
            if name not in said:
                raise InvalidValue(f"--{name.replace('_', '-')}", value, "none: the file says it")
            if value != said[name]:
                raise InvalidValue(f"--{name}", value, f"{said[name]}, as the file says")
