"""Pushes on a hand: what makes a demonstrator leave its path, so that its way back is recorded."""

from __future__ import annotations

import math

import numpy as np

from common.se3 import Array

_PLAIN_SHARE = 0.2
"""Share of episodes without any push: the path itself must be well known too."""
_LEVELS = (0.4, 1.3)
_FLOOR_M, _FLOOR_RAD = 0.0018, 0.008
_SHARE_OF_MOTION = 0.12
"""A hand is the less exact the faster it moves."""
_CORRELATION = 0.6
_BUMP_CHANCE = 0.04
_BUMP_M, _BUMP_RAD = 0.012, 0.06


class Disturbance:
    """A push per 10 Hz step, correlated in time.

    e_k = rho e_{k-1} + sqrt(1 - rho^2) sigma_k n_k + bumps, n_k ~ N(0, I),
    sigma_k = level (floor + share |step_k|), separately for translation [m] and rotation [rad].

    Args:
        random: Draws the level of the episode, and every push.
    """

    def __init__(self, random: np.random.Generator) -> None:
        self._random = random
        plain = random.random() < _PLAIN_SHARE
        level = random.uniform(*_LEVELS)
        self.level = 0.0 if plain else float(level)
        self._push = np.zeros(6)

    def draw(
        self, translation_m: Array, rotation_rad: Array, *, care: float = 1.0
    ) -> tuple[Array, Array]:
        """Push on a step.

        Args:
            translation_m: (3,) that the hand wants to move.
            rotation_rad: (3,) that it wants to turn.
            care: What is left of fresh pushes, in [0, 1].

        Returns:
            (3,) [m] and (3,) [rad] in the hand's frame.
        """
        noise = self._random.normal(size=6)
        bumped = self._random.random() < _BUMP_CHANCE
        bump = self._random.normal(size=6)
        moved_m = math.sqrt(float(translation_m @ translation_m))
        turned_rad = math.sqrt(float(rotation_rad @ rotation_rad))
        sigma = np.repeat(
            [_FLOOR_M + _SHARE_OF_MOTION * moved_m, _FLOOR_RAD + _SHARE_OF_MOTION * turned_rad], 3
        )
        fresh = math.sqrt(1.0 - _CORRELATION**2) * sigma * noise
        if bumped:
            fresh = fresh + np.repeat([_BUMP_M, _BUMP_RAD], 3) * bump
        self._push = _CORRELATION * self._push + care * self.level * fresh
        return self._push[:3].copy(), self._push[3:].copy()

    def rest(self) -> None:
        """The hand stands still on purpose: no push, and none left over."""
        self._push[:] = 0.0
