from __future__ import annotations

from typing import Annotated, ClassVar

from annotated_types import Ge
from pydantic import Field

from common.messages.base import Message, Name, Natural
from common.messages.checkpoint import CheckpointDescription

ONLY_CELLS = "only_cells"
"""In `offers`: patterns of the only cells in which the node has rights; without it, all."""


class NodeDescription(Message):
    """What a node is and offers; the answer to `describe`."""

    version: ClassVar[int] = 2

    kind: Name
    node: Name
    code_version: str
    packages: dict[str, str]
    """Versions of the third-party packages that shape its results."""
    host: str
    pid: Natural
    started_unix_s: Annotated[float, Ge(0)]
    offers: dict[str, list[str]]
    """What it can serve: `robots`, `policies`, `tasks`, `cells`; `only_cells`: where it may."""
    checkpoints: dict[Name, CheckpointDescription] = Field(
        default_factory=dict[Name, CheckpointDescription]
    )
    """Which of the policies are learned, and what they are."""

    @property
    def owner(self) -> str:
        """The node it speaks of."""
        return self.node


class NodeMetrics(Message):
    """Counters of a node since it started; sent once a second."""

    node: Name
    handled: Natural
    published: Natural
    rejected: Natural
    """Messages of a wrong schema or shape."""
    superseded: Natural
    """Messages replaced by a newer one before they were handled."""
    stale: Natural
    """Messages of another epoch."""
    gaps: Natural
    """Sequence numbers that never arrived."""
    handle_time_s: Annotated[float, Ge(0)]
    """Time inside the reactor."""

    @property
    def owner(self) -> str:
        """The node it speaks of."""
        return self.node
