"""What a robot does in real time when its episode is over: it comes to rest and stays there."""

from __future__ import annotations

import logging

from common.clock import RealtimePacer
from common.errors import ModelError
from services.sim.body import GuardedBody

log = logging.getLogger(__name__)


class Hold:
    """Goes on with a world, brakes its robot and holds it, until the cell is configured again.

    Nobody is listened to and nothing is published: it needs no bus.

    Args:
        body: The robot in its world.
        pacer: Of the episode, whose ticks go on.
    """

    def __init__(self, body: GuardedBody, pacer: RealtimePacer) -> None:
        self.body = body
        self._pacer = pacer
        self._ended = False
        body.guard.stop()

    def pass_time(self, now_ns: int) -> None:
        """Take the next tick when it is due.

        Args:
            now_ns: This process's monotonic clock.
        """
        if self._ended or not self._pacer.due(now_ns):
            return
        self.body.command()
        try:
            self.body.advance()
        except ModelError as error:
            self._ended = True
            log.error("the world cannot go on", extra=error.describe())
