from __future__ import annotations

from typing import Annotated, Literal

from annotated_types import Len
from pydantic import BaseModel

from common.messages.base import MODEL_CONFIG, Message, Name
from common.messages.episode import Problem

FolderPath = Annotated[str, Len(1, 4096)]


class CheckpointDescription(BaseModel):
    """A learned policy that a policy service has in memory."""

    model_config = MODEL_CONFIG

    sha256: Annotated[str, Len(64, 64)]
    """Over weights, config and statistics."""
    folder: FolderPath
    """On the policy host."""
    method: Name
    tasks: Annotated[list[Name], Len(1, 64)]
    """What it was trained for."""
    runtime: str
    """Library that runs it, with its version."""
    device: str
    decoding: Literal["most-likely", "sample"]
    """From its mixture to an action."""


class PolicyLoad(Message):
    """Load a checkpoint under a name, in place of one that has it. Answered by `PolicyLoaded`.

    Episodes that have begun keep what they began with.
    """

    request: Name
    """Comes back in the answer."""
    node: Name
    """The policy service that is meant."""
    policy: Name
    folder: FolderPath
    """On the policy host; a relative one is below its `--checkpoints`."""


class PolicyLoaded(Message):
    """A policy service has loaded a checkpoint, or says why it has not."""

    request: Name
    node: Name
    policy: Name
    checkpoint: CheckpointDescription | None = None
    problem: Problem | None = None
    """Set if and only if `checkpoint` is not."""

    @property
    def owner(self) -> str:
        """The node it speaks of."""
        return self.node
