"""From a request to its trials: seeds and order."""

from __future__ import annotations

import numpy as np

from common.api import EvaluationRequest
from common.errors import InvalidValue
from services.control.events import TrialSpec

MAX_TRIALS = 100_000
"""Trials of one evaluation; a larger grid is several evaluations."""


def trial_seed(seed: int, index: int) -> int:
    """Seed of trial i, the same for every task, robot and policy so that they can be paired.

    A spawned NumPy seed sequence: neighbouring indices give unrelated streams.

    Args:
        seed: Seed of the evaluation.
        index: i, from 0.
    """
    sequence = np.random.SeedSequence(entropy=seed, spawn_key=(index,))
    return int(sequence.generate_state(1)[0])


def expand_grid(evaluation: str, request: EvaluationRequest) -> tuple[TrialSpec, ...]:
    """All trials in the order they are handed out: trial 0 of the whole grid, then trial 1.

    Raises:
        InvalidValue: The grid has more than `MAX_TRIALS` trials.
    """
    lanes = [
        (task, robot, policy)
        for task in request.tasks
        for policy in request.policy_names
        for robot in request.robots
    ]
    total = request.trials * len(lanes)
    if total > MAX_TRIALS:
        raise InvalidValue("trials", request.trials, f"at most {MAX_TRIALS // len(lanes)}")
    seeds = [trial_seed(request.seed, index) for index in range(request.trials)]
    return tuple(
        TrialSpec(evaluation, index * len(lanes) + number, index, *lane, seeds[index])
        for index in range(request.trials)
        for number, lane in enumerate(lanes)
    )
