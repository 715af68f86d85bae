"""Statistics of a data set's actions: units for the network and for the invariants.

Normalised action a = u / s with, per axis, s = 1.2 max(|q01|, |q99|), at least 1 mm or 5 mrad,
where q01 and q99 are the 1 % and 99 % quantiles. The quantile range then lies within [-1, 1] with a
margin that tanh means can reach. The map has no offset: rest stays zero, so the zeros before the
start of a history and the last action of a demonstration need no exception.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Self, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt
from annotated_types import Ge, Gt, Le
from pydantic import BaseModel, ConfigDict, model_validator

from common.errors import InvalidValue
from common.se3 import Array

if TYPE_CHECKING:
    from torch import Tensor

MARGIN = 1.2
FLOOR_M = 1e-3
FLOOR_RAD = 5e-3

Triple: TypeAlias = tuple[float, float, float]
Share: TypeAlias = Annotated[float, Ge(0), Le(1)]

Values = TypeVar("Values", float, Array, "Tensor")

_CONFIG = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class BlockStatistics(BaseModel):
    """Translation [m] or rotation [rad] of all actions, per axis."""

    model_config = _CONFIG

    q01: Triple
    q99: Triple
    floor: Annotated[float, Gt(0)]
    """Smallest scale."""
    rms: Annotated[float, Ge(0)]
    """Root of the mean square length."""
    outside: tuple[Share, Share, Share]
    """Share of actions beyond the scale, which a tanh mean cannot reach."""

    @model_validator(mode="after")
    def _quantiles_are_ordered(self) -> Self:
        if any(low > high for low, high in zip(self.q01, self.q99, strict=True)):
            raise ValueError("q01 is above q99")
        return self

    @property
    def scale(self) -> Triple:
        """s, per axis."""
        x, y, z = (
            max(MARGIN * max(abs(low), abs(high)), self.floor)
            for low, high in zip(self.q01, self.q99, strict=True)
        )
        return x, y, z

    @classmethod
    def of(cls, values: Array, *, floor: float) -> Self:
        """Statistics of (n, 3) values."""
        q01, q99 = np.quantile(values, [0.01, 0.99], axis=0)
        scale = np.maximum(MARGIN * np.maximum(np.abs(q01), np.abs(q99)), floor)
        return cls(
            q01=tuple(q01.tolist()),
            q99=tuple(q99.tolist()),
            floor=floor,
            rms=math.sqrt(float(np.mean(np.sum(values * values, axis=1)))),
            outside=tuple(np.mean(np.abs(values) > scale, axis=0).tolist()),
        )


class MotionScale(BaseModel):
    """Typical lengths S of a step and a turn: the units of the smooth invariants."""

    model_config = _CONFIG

    step_m: Annotated[float, Gt(0)]
    turn_rad: Annotated[float, Gt(0)]


class ActionStatistics(BaseModel):
    """What training knows of the data set's actions and deployment must know too."""

    model_config = _CONFIG

    count: Annotated[int, Ge(1)]
    zero_share: Share
    """Of actions that are exactly rest."""
    translation: BlockStatistics
    rotation: BlockStatistics

    @property
    def scale(self) -> tuple[float, ...]:
        """(6,) s of translation [m] and rotation [rad]: action = scale * normalised action."""
        return (*self.translation.scale, *self.rotation.scale)

    @property
    def motion_scale(self) -> MotionScale:
        """RMS lengths, at least the floors: a data set without turns has a unit all the same."""
        return MotionScale(
            step_m=max(self.translation.rms, self.translation.floor),
            turn_rad=max(self.rotation.rms, self.rotation.floor),
        )

    @classmethod
    def of(cls, actions: npt.NDArray[np.floating]) -> Self:
        """Statistics of all actions of a data set.

        Args:
            actions: (n, 6) translation [m] and rotation vector [rad].

        Raises:
            InvalidValue: Another shape, no action, or numbers that are not finite.
        """
        if actions.ndim != 2 or actions.shape[1] != 6 or len(actions) == 0:
            raise InvalidValue("actions", list(actions.shape), "shape (n, 6) with n > 0")
        if not np.isfinite(actions).all():
            raise InvalidValue("actions", "not finite", "finite numbers")
        values = actions.astype(np.float64)
        return cls(
            count=len(values),
            zero_share=float(np.mean(np.all(values == 0.0, axis=1))),
            translation=BlockStatistics.of(values[:, :3], floor=FLOOR_M),
            rotation=BlockStatistics.of(values[:, 3:], floor=FLOOR_RAD),
        )


def normalise_grasp(grasp: Values) -> Values:
    """A grasp in [0, 1] as a dimension of a mixture: (2 g - 1) / 1.2, which tanh can reach."""
    return (2.0 * grasp - 1.0) / MARGIN


def denormalise_grasp(value: Values) -> Values:
    """Inverse of `normalise_grasp`; closed above 0.5."""
    return 0.5 * (MARGIN * value + 1.0)
