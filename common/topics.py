"""THE table: topic name -> message type -> rate -> quality of service.

A message type has exactly one topic. Keys are `cell/<cell>/<name>` for what belongs to a cell and
`<name>/<node>` for what belongs to a node; the namespace in front of them is the session's.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

from common import messages as m
from common.errors import UnknownName

Scope = Literal["cell", "node"]
Priority = Literal["real_time", "interactive_high", "data", "background"]


@dataclass(frozen=True)
class Topic:
    """One row of the table.

    Args:
        name: Last part of the key.
        message: The only type that may travel on it.
        scope: Whose key it is.
        rate_hz: Usual rate in simulated time; 0 = sporadic.
        depth: How many messages of one cell wait at a receiver; 1 = only the newest.
        priority: Zenoh priority.
        lossless: Also in real-time mode, wait (bounded) rather than drop when a link is full.
    """

    name: str
    message: type[m.Message]
    scope: Scope
    rate_hz: float
    depth: int
    priority: Priority
    lossless: bool

    @cached_property
    def is_control(self) -> bool:
        """Whether it starts, ends or reports episodes: every node hears these of every cell."""
        return self.name.startswith("episode/")

    @cached_property
    def is_fenced(self) -> bool:
        """Whether only messages of the cell's current epoch count; a stop always does."""
        return self.scope == "cell" and not self.name.startswith("safety/")


TOPICS: tuple[Topic, ...] = (
    # Receivers drain topics in the order of this table: safety first, then episode control.
    Topic("safety/stop", m.SafetyStop, "cell", 0, 8, "real_time", True),
    Topic("safety/reset", m.SafetyReset, "cell", 0, 8, "interactive_high", True),
    Topic("safety/state", m.SafetyState, "cell", 1, 1, "real_time", True),
    Topic("episode/abort", m.EpisodeAbort, "cell", 0, 8, "interactive_high", True),
    Topic("episode/configure", m.EpisodeConfigure, "cell", 0, 8, "interactive_high", True),
    Topic("episode/ready", m.EpisodeReady, "cell", 0, 64, "interactive_high", True),
    Topic("episode/start", m.EpisodeStart, "cell", 0, 8, "interactive_high", True),
    Topic("episode/event", m.EpisodeEvent, "cell", 0, 64, "data", True),
    Topic("episode/picture", m.EpisodePicture, "cell", 0, 64, "data", True),
    Topic("episode/result", m.EpisodeResult, "cell", 0, 8, "data", True),
    Topic("policy/action", m.PolicyAction, "cell", 10, 4, "interactive_high", True),
    Topic("robot/state", m.RobotState, "cell", 100, 1, "interactive_high", False),
    Topic("robot/command", m.RobotCommand, "cell", 100, 1, "real_time", False),
    Topic("retarget/status", m.RetargetStatus, "cell", 10, 1, "real_time", False),
    Topic("gripper/motor_state", m.MotorState, "cell", 100, 1, "interactive_high", False),
    Topic("gripper/motor_command", m.MotorCommand, "cell", 100, 1, "real_time", False),
    Topic("gripper/state", m.GripperState, "cell", 10, 1, "data", False),
    Topic("camera/stereo", m.StereoFrame, "cell", 10, 1, "data", False),
    Topic("truth", m.GroundTruth, "cell", 10, 1, "data", False),
    Topic("policy/load", m.PolicyLoad, "node", 0, 8, "data", True),
    Topic("policy/loaded", m.PolicyLoaded, "node", 0, 8, "data", True),
    Topic("describe", m.NodeDescription, "node", 0, 64, "data", True),
    Topic("metrics", m.NodeMetrics, "node", 1, 8, "background", False),
)

_BY_NAME = {topic.name: topic for topic in TOPICS}
_BY_MESSAGE = {topic.message: topic for topic in TOPICS}


def topic_named(name: str) -> Topic:
    """Look a topic up by its name.

    Raises:
        UnknownName: There is none of that name.
    """
    try:
        return _BY_NAME[name]
    except KeyError:
        raise UnknownName("topic", name, list(_BY_NAME)) from None


def topic_of(message: type[m.Message]) -> Topic:
    """The topic on which messages of this type travel."""
    return _BY_MESSAGE[message]


def topics_of(messages: Iterable[type[m.Message]]) -> tuple[Topic, ...]:
    """Topics of several message types, in the order of the table."""
    wanted = set(messages)
    return tuple(topic for topic in TOPICS if topic.message in wanted)


def key_of(topic: Topic, owner: str) -> str:
    """Key of a topic for one cell or node; `*` stands for all of them."""
    return f"cell/{owner}/{topic.name}" if topic.scope == "cell" else f"{topic.name}/{owner}"


def owner_of(topic: Topic, key: str) -> str:
    """Cell or node that a key belongs to, the inverse of `key_of`."""
    return key.split("/", 2)[1] if topic.scope == "cell" else key.rsplit("/", 1)[1]
