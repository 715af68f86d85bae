"""The base of every message: strict, frozen, finite, with a header."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, ClassVar, Literal, Self, TypeVar

from annotated_types import Ge, Le, Len
from pydantic import AfterValidator, BaseModel, ConfigDict, StringConstraints

_UNIT_TOLERANCE = 1e-3

Pose = TypeVar("Pose", bound=Sequence[float])


def has_unit_quaternion(pose: Sequence[float]) -> bool:
    """Whether the quaternion of `[x, y, z, qw, qx, qy, qz]` has length 1, up to rounding."""
    return abs(math.hypot(*pose[3:7]) - 1.0) <= _UNIT_TOLERANCE


def check_pose(pose: Pose) -> Pose:
    """Give a pose `[x, y, z, qw, qx, qy, qz]` back if it is one.

    Raises:
        ValueError: Its quaternion is not normalised.
    """
    if not has_unit_quaternion(pose):
        raise ValueError(f"the quaternion has length {math.hypot(*pose[3:7]):g}, expected 1")
    return pose


Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.@-]{0,63}$")]
"""A name that may stand in a key: a cell, a node, a robot, a task, a policy."""

Vector3 = Annotated[list[float], Len(3, 3)]
"""Three numbers; the field's name says the frame and the unit."""

PoseWire = Annotated[list[float], Len(7, 7), AfterValidator(check_pose)]
"""A pose `[x, y, z, qw, qx, qy, qz]`: metres and a unit quaternion wxyz."""

LARGEST_JOINT_VALUE = 1000.0
"""No joint is further away or faster [rad, m, rad/s, m/s]: whatever is, is not a measurement."""

Joints = Annotated[
    list[Annotated[float, Ge(-LARGEST_JOINT_VALUE), Le(LARGEST_JOINT_VALUE)]], Len(1, 64)
]
"""One number per degree of freedom, in the order of the robot's model."""

Natural = Annotated[int, Ge(0)]

Share = Annotated[float, Ge(0), Le(1)]
"""How much of something, from 0 = nothing to 1 = all of it."""

Mode = Literal["lockstep", "realtime"]

Model = TypeVar("Model", bound=BaseModel)

MODEL_CONFIG = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)


class Header(BaseModel):
    """Where a message comes from and which moment it speaks of.

    `seq` and `t_mono_ns` are stamped by the runner when the message leaves the process;
    `t_mono_ns` is the sender's monotonic clock and is comparable only within one host.
    """

    model_config = MODEL_CONFIG

    cell: str = ""
    episode: str = ""
    epoch: Natural = 0
    source: str = ""
    seq: Natural = 0
    step: Annotated[int, Ge(-1)] = 0
    """Simulation control tick, 100 Hz."""
    t_sim_s: float = 0.0
    t_mono_ns: Natural = 0

    def at(self, step: int, t_sim_s: float) -> Self:
        """The header of another moment of the same episode; sender and time are the runner's."""
        return _replaced(self, step=step, t_sim_s=t_sim_s)


class Message(BaseModel):
    """A typed message. `version` rises whenever a field changes."""

    model_config = MODEL_CONFIG
    version: ClassVar[int] = 1

    header: Header

    @classmethod
    def schema_name(cls) -> str:
        """Name and version as they stand in the encoding, e.g. `legato.RobotState.v1`."""
        return f"legato.{cls.__name__}.v{cls.version}"

    @property
    def owner(self) -> str:
        """The cell or node it speaks of, on whose key it has to come."""
        return self.header.cell or self.header.source

    def stamped(self, *, source: str, seq: int, t_mono_ns: int) -> Self:
        """The same message as it leaves a process: who sent it, as which one, and when."""
        header = _replaced(self.header, source=source, seq=seq, t_mono_ns=t_mono_ns)
        return _replaced(self, header=header)


# All that a model holds, past the check that frozen ones make of every assignment.
_set_fields, _set_fields_set, _set_extra, _set_private = (
    vars(BaseModel)[slot].__set__
    for slot in (
        "__dict__",
        "__pydantic_fields_set__",
        "__pydantic_extra__",
        "__pydantic_private__",
    )
)


def _replaced(model: Model, **changes: object) -> Model:
    """A copy with other values of some fields, which are known to be valid.

    `model_copy` does the same three times slower, for models that we do not have (private
    attributes, extra fields); this runs for every message.
    """
    copy = object.__new__(type(model))
    _set_fields(copy, model.__dict__ | changes)
    _set_fields_set(copy, model.__pydantic_fields_set__)
    _set_extra(copy, None)
    _set_private(copy, None)
    return copy


class Reply(Message):
    """A message that answers another one.

    `request_t_mono_ns` echoes the request's stamp, so that the asker measures the round trip on
    its own clock.
    """

    for_step: Natural
    request_t_mono_ns: Natural
