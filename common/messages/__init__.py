"""One file per family of typed messages. `ALL` lists every message that may be on the bus."""

from __future__ import annotations

from common.messages.base import Header, Message, Mode, PoseWire, Reply
from common.messages.camera import StereoFrame
from common.messages.checkpoint import CheckpointDescription, PolicyLoad, PolicyLoaded
from common.messages.episode import (
    STAGES,
    Distribution,
    EpisodeAbort,
    EpisodeConfigure,
    EpisodeEvent,
    EpisodePicture,
    EpisodeReady,
    EpisodeResult,
    EpisodeStart,
    Outcome,
    Problem,
    StagesReached,
    TrialResult,
    WallTimes,
)
from common.messages.gripper import GripperState, MotorCommand, MotorState
from common.messages.local import AskDescription, LocalMessage, NodeDown, NodeUp, Tick
from common.messages.node import ONLY_CELLS, NodeDescription, NodeMetrics
from common.messages.policy import ActionStep, GroundTruth, Motion, PolicyAction
from common.messages.robot import RetargetStatus, RobotCommand, RobotState
from common.messages.safety import (
    SafetyCounts,
    SafetyReset,
    SafetyState,
    SafetyStatus,
    SafetyStop,
)

ALL: tuple[type[Message], ...] = (
    RobotState,
    RobotCommand,
    RetargetStatus,
    MotorState,
    MotorCommand,
    GripperState,
    StereoFrame,
    PolicyAction,
    GroundTruth,
    SafetyStop,
    SafetyReset,
    SafetyState,
    EpisodeConfigure,
    EpisodeReady,
    EpisodeStart,
    EpisodeAbort,
    EpisodeEvent,
    EpisodePicture,
    EpisodeResult,
    PolicyLoad,
    PolicyLoaded,
    NodeDescription,
    NodeMetrics,
)

__all__ = [
    "ALL",
    "Header",
    "Message",
    "Reply",
    "Mode",
    "PoseWire",
    "LocalMessage",
    "Tick",
    "NodeUp",
    "NodeDown",
    "AskDescription",
    "RobotState",
    "RobotCommand",
    "RetargetStatus",
    "MotorState",
    "Motion",
    "MotorCommand",
    "GripperState",
    "StereoFrame",
    "ActionStep",
    "PolicyAction",
    "GroundTruth",
    "SafetyStatus",
    "SafetyCounts",
    "SafetyStop",
    "SafetyReset",
    "SafetyState",
    "Problem",
    "Outcome",
    "Distribution",
    "STAGES",
    "StagesReached",
    "WallTimes",
    "TrialResult",
    "EpisodeConfigure",
    "EpisodeReady",
    "EpisodeStart",
    "EpisodeAbort",
    "EpisodeEvent",
    "EpisodePicture",
    "EpisodeResult",
    "CheckpointDescription",
    "PolicyLoad",
    "PolicyLoaded",
    "ONLY_CELLS",
    "NodeDescription",
    "NodeMetrics",
]
