"""What a data set is: `dataset.json`."""

from __future__ import annotations

import hashlib
import json
import math
from typing import Annotated, Literal, Self

import numpy as np
import numpy.typing as npt
from annotated_types import Ge, Gt, Len
from pydantic import BaseModel, ConfigDict, JsonValue, StringConstraints, model_validator

from common.calibration import StereoCalibration
from common.messages.base import Name

FORMAT = "legato.dataset"
VERSION = 1
IMAGES = "images"
EYES = 2

_CONFIG = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

ColumnName = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]{0,63}$")]
_DTYPES = {"u8": "|u1", "i64": "<i8", "f32": "<f4", "f64": "<f8"}


class ColumnSpec(BaseModel):
    """One column: a flat file `<name>.<dtype>` of rows of fixed size, little-endian."""

    model_config = _CONFIG

    name: ColumnName
    dtype: Literal["u8", "i64", "f32", "f64"]
    shape: tuple[Annotated[int, Ge(1)], ...] = ()
    """Of one row; empty = one number."""
    unit: str
    meaning: str
    privileged: bool = False
    """Known to the simulation only: never the input of a policy."""

    @property
    def file(self) -> str:
        """Name of its file."""
        return f"{self.name}.{self.dtype}"

    @property
    def numpy_dtype(self) -> np.dtype[np.generic]:
        """As NumPy calls it."""
        return np.dtype(_DTYPES[self.dtype])

    @property
    def row_bytes(self) -> int:
        """Size of one row."""
        return math.prod(self.shape) * self.numpy_dtype.itemsize


class CameraSpec(BaseModel):
    """The stereo camera that made the images."""

    model_config = _CONFIG

    name: Name
    width: Annotated[int, Ge(1)]
    height: Annotated[int, Ge(1)]
    calibration: dict[str, JsonValue]
    sha256: Annotated[str, Len(64, 64)]
    """Of the calibration as JSON with sorted keys and no blanks."""

    @classmethod
    def of(cls, calibration: StereoCalibration) -> Self:
        """From a calibration."""
        fields = calibration.model_dump(mode="json")
        canonical = json.dumps(fields, sort_keys=True, separators=(",", ":"))
        return cls(
            name=calibration.name,
            width=calibration.width,
            height=calibration.height,
            calibration=fields,
            sha256=hashlib.sha256(canonical.encode()).hexdigest(),
        )


class DatasetSpec(BaseModel):
    """All episodes of a data set have one origin: this."""

    model_config = _CONFIG

    format: Literal["legato.dataset"] = FORMAT
    version: Literal[1] = VERSION
    task: Name
    robot: Name
    rate_hz: Annotated[float, Gt(0)]
    """Rows per second."""
    tick_rate_hz: Annotated[float, Gt(0)]
    """What `frame_step` and `state_step` count."""
    reference_delay_ticks: Annotated[int, Ge(0)]
    """How much later the robot gets to know its reference."""
    camera: CameraSpec
    action_convention: str
    columns: tuple[ColumnSpec, ...]
    """In the order in which an episode is hashed."""
    recording: dict[str, JsonValue]
    """How it was made, e.g. policy and seed."""
    software: dict[str, str]
    """Code and packages that shape what is recorded."""

    @model_validator(mode="after")
    def _columns_are_distinct(self) -> Self:
        names = [column.name for column in self.columns]
        if not names or len(set(names)) != len(names):
            raise ValueError("columns need distinct names, and at least one")
        images = [column for column in self.columns if column.name == IMAGES]
        shape = (EYES, self.camera.height, self.camera.width)
        if images and (images[0].shape, images[0].dtype) != (shape, "u8"):
            raise ValueError(f"column images has shape {images[0].shape}, expected {shape} of u8")
        return self

    @property
    def row_bytes(self) -> int:
        """Size of one row of all columns."""
        return sum(column.row_bytes for column in self.columns)

    def first_difference(self, other: DatasetSpec) -> tuple[str, object, object] | None:
        """The first field in which two differ, with both values; None when they are equal."""
        for field in type(self).model_fields:
            mine, theirs = getattr(self, field), getattr(other, field)
            if mine == theirs:
                continue
            if isinstance(mine, dict):
                keys = sorted({*mine, *theirs})
                key = next(key for key in keys if mine.get(key) != theirs.get(key))
                return f"{field}.{key}", mine.get(key), theirs.get(key)
            if isinstance(mine, CameraSpec):
                return "camera", _brief(mine), _brief(theirs)
            if field == "columns":
                return field, _names(self.columns), _names(other.columns)
            return field, mine, theirs
        return None


def _brief(camera: CameraSpec) -> str:
    return f"{camera.name} (calibration {camera.sha256[:8]})"


def _names(columns: tuple[ColumnSpec, ...]) -> str:
    return " ".join(f"{column.file}{list(column.shape)}" for column in columns)


Rows = npt.NDArray[np.generic]
"""Values of one column, first axis the rows."""
