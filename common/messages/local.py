"""Messages that never leave a process: time and the presence of other nodes.

They reach a reactor the same way as messages from the bus, so that time-outs and lost nodes are
tested by handing messages in.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LocalMessage:
    """Something the runner or an edge of this process tells the reactor."""


@dataclass(frozen=True)
class Tick(LocalMessage):
    """Time has passed. `t_mono_ns` is this process's monotonic clock."""

    t_mono_ns: int


@dataclass(frozen=True)
class NodeUp(LocalMessage):
    """A node declared its liveliness token: it is ready."""

    kind: str
    node: str


@dataclass(frozen=True)
class NodeDown(LocalMessage):
    """A node's liveliness token is gone: it stopped, died or cannot be reached."""

    kind: str
    node: str


@dataclass(frozen=True)
class AskDescription(LocalMessage):
    """A reactor's wish to know what a node is. Answered by a `NodeDescription`."""

    node: str
