"""How far an episode has come, told from what the success test sees and says."""

from __future__ import annotations

from typing import Final

from common.clock import TICK_S
from common.messages import StagesReached
from common.tasks.task import Judgement, TaskState

HOLD_S: Final = 0.2
"""An object that is touched for shorter than this is not held yet."""
LIFT_M: Final = 0.020

_HOLD_TICKS: Final = round(HOLD_S / TICK_S)


class StageMonitor:
    """Remembers the stages of `StagesReached`, which says what each of them means.

    It computes nothing of its own: while the grasp is closed the success test looks at frames
    only, so a touch is known every 0.1 s.

    Args:
        moved_object: The object whose placement is the goal.
    """

    def __init__(self, moved_object: str) -> None:
        self._object = moved_object
        self._held_since: int | None = None
        self._grasped = self._lifted = self._placed = self._released = False

    @property
    def reached(self) -> StagesReached:
        """The stages so far."""
        return StagesReached(
            grasped=self._grasped,
            lifted=self._lifted,
            placed=self._placed,
            released=self._released,
        )

    def update(self, state: TaskState, judgement: Judgement, *, step: int) -> None:
        """Take what the success test was shown at a tick, and what it said."""
        if not state.grasp or self._object not in state.touching_robot:
            self._held_since = None
        elif self._held_since is None:
            self._held_since = step
        elif step - self._held_since >= _HOLD_TICKS:
            self._grasped = True
            self._lifted = self._lifted or self._rise_m(state) >= LIFT_M
        if judgement.placed:
            self._placed = True
            self._released = self._released or judgement.holds

    def _rise_m(self, state: TaskState) -> float:
        now, start = state.objects[self._object], state.initial[self._object]
        return float(now.T_world_object[2, 3] - start.T_world_object[2, 3])
