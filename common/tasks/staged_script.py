"""What all demonstrators' plans share: stages, each planned from what is seen when it begins."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from typing import TypeAlias

from common.tasks.task import DemonstratorView, Waypoint

Stage: TypeAlias = Callable[[DemonstratorView], Sequence[Waypoint]]


class StagedScript(ABC):
    """A plan in stages: a stage gives its waypoints and sets which stage follows."""

    def __init__(self) -> None:
        self._plan: Iterator[Waypoint] = iter(())
        self._stage: Stage = self._approach
        self._done = False

    def next_waypoint(self, view: DemonstratorView) -> Waypoint | None:
        """Next piece of the current stage; a finished stage plans the next from what is seen."""
        while not self._done:
            waypoint = next(self._plan, None)
            if waypoint is not None:
                return waypoint
            self._plan = iter(self._stage(view))
        return None

    @abstractmethod
    def _approach(self, view: DemonstratorView) -> Sequence[Waypoint]:
        """The first stage."""
