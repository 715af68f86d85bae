"""The one tree of errors.

LegatoError
├─ ConfigError      UnknownName, InvalidValue, BadCertificate, MissingExtra, MissingProgram,
│                   UntrainedTask, BadKeyFile, BadGrants, NotRevocable, Exposed
├─ AccessError      KeyRefused, RoleTooLow, ForeignPage, TooManyCalls
├─ ContractError    SchemaMismatch, MalformedMessage, ForeignMessage, WrongShape
├─ ModelError       BadRobotFile, ModelMismatch, BadCalibration, FootholdOutOfReach,
│                   UnsupportedGeom, BadMeshes, MeshesDoNotFit
├─ LinkError        RouterUnreachable (and RouterRefused), NotReady, NodeTimeout, AlreadyRunning,
│                   PortInUse
├─ SafetyError      EmergencyStopped, StaleCommand
└─ StoreError       NotFound, NotWritable

Each class is built from data, has a stable code and says what happened, what was expected or
available, and what to do. Three edges translate it: the command line, REST (problem+json) and the
bus (`EpisodeReady.problem`). Nothing else catches broadly.
"""

from __future__ import annotations

from common.errors.access import (
    AccessError,
    ForeignPage,
    KeyRefused,
    RoleTooLow,
    TooManyCalls,
)
from common.errors.base import (
    LegatoError,
)
from common.errors.config import (
    BadCertificate,
    BadGrants,
    BadKeyFile,
    ConfigError,
    Exposed,
    InvalidValue,
    MissingExtra,
    MissingProgram,
    NotRevocable,
    UnknownName,
    UntrainedTask,
)
from common.errors.contract import (
    ContractError,
    ForeignMessage,
    MalformedMessage,
    SchemaMismatch,
    WrongShape,
)
from common.errors.link import (
    AlreadyRunning,
    LinkError,
    NodeTimeout,
    NotReady,
    PortInUse,
    RouterRefused,
    RouterUnreachable,
)
from common.errors.model import (
    BadCalibration,
    BadMeshes,
    BadRobotFile,
    FootholdOutOfReach,
    MeshesDoNotFit,
    ModelError,
    ModelMismatch,
    UnsupportedGeom,
)
from common.errors.safety import (
    EmergencyStopped,
    SafetyError,
    StaleCommand,
)
from common.errors.store import (
    NotFound,
    NotWritable,
    StoreError,
)

__all__ = [
    "AccessError",
    "AlreadyRunning",
    "BadCalibration",
    "BadCertificate",
    "BadGrants",
    "BadKeyFile",
    "BadMeshes",
    "BadRobotFile",
    "ConfigError",
    "ContractError",
    "EmergencyStopped",
    "Exposed",
    "FootholdOutOfReach",
    "ForeignMessage",
    "ForeignPage",
    "InvalidValue",
    "KeyRefused",
    "LegatoError",
    "LinkError",
    "MalformedMessage",
    "MeshesDoNotFit",
    "MissingExtra",
    "MissingProgram",
    "ModelError",
    "ModelMismatch",
    "NodeTimeout",
    "NotFound",
    "NotReady",
    "NotRevocable",
    "NotWritable",
    "PortInUse",
    "RoleTooLow",
    "RouterRefused",
    "RouterUnreachable",
    "SafetyError",
    "SchemaMismatch",
    "StaleCommand",
    "StoreError",
    "TooManyCalls",
    "UnknownName",
    "UnsupportedGeom",
    "UntrainedTask",
    "WrongShape",
]
