"""Policies that must fail: what a success rate is worth is seen beside them."""

from __future__ import annotations

import numpy as np

from common.messages import ActionStep
from services.policy.policy import Observation


class HoldPolicy:
    """Never moves. Whatever it succeeds at is not a task."""

    needs_truth = False

    def reset(self, *, seed: int, task: str) -> None:
        """Nothing to forget."""

    def act(self, observation: Observation) -> list[ActionStep]:
        """Stay, fingers open."""
        del observation
        return [ActionStep(translation_m=[0.0] * 3, rotation_rad=[0.0] * 3, grasp=False)]


class RandomPolicy:
    """Moves at random within the expert's speeds."""

    needs_truth = False

    def __init__(self) -> None:
        self._random = np.random.default_rng(0)

    def reset(self, *, seed: int, task: str) -> None:
        """Start the random sequence of this seed."""
        del task
        self._random = np.random.default_rng([seed, 1])

    def act(self, observation: Observation) -> list[ActionStep]:
        """A small random motion."""
        del observation
        return [
            ActionStep(
                translation_m=self._random.normal(0.0, 0.008, size=3).tolist(),
                rotation_rad=self._random.normal(0.0, 0.03, size=3).tolist(),
                grasp=bool(self._random.random() < 0.3),
            )
        ]
