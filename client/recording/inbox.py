"""An inbox for a reader that needs the robot's state at frames only."""

from __future__ import annotations

from typing import Any

from common.bus import Inbox, Received
from common.messages import RobotState
from common.topics import topic_of

_STATE = topic_of(RobotState)


class FrameInbox(Inbox):
    """States wait until something else comes, the newest winning; so nine of ten are not decoded.

    In one thread the state of a frame's tick is put right after the frame, before the reader's
    turn: that is the one it finds.
    """

    def __init__(self) -> None:
        super().__init__()
        self._due = False

    def put(self, received: Received) -> None:
        """Store bytes from the bus."""
        super().put(received)
        if received.topic is not _STATE:
            self._due = True

    def put_event(self, event: Any) -> None:
        """Store something that must not be lost."""
        super().put_event(event)
        self._due = True

    def drain(self) -> tuple[list[Any], list[Received]]:
        """Take everything that waits, if there is more than a state."""
        if not self._due:
            return [], []
        self._due = False
        return super().drain()
