"""Policies that are due together: those that share a network share its pass."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from common.errors import LegatoError
from common.messages import ActionStep
from services.policy.policy import Observation, Policy
from services.policy.serving.backend import StepInput
from services.policy.serving.learned import LearnedPolicy, step_together

Due: TypeAlias = tuple[Policy, Observation]


@dataclass(frozen=True, eq=False)
class Pass:
    """One pass of one policy. Compared by identity: those who shared it have the same one.

    Args:
        inference_s: How long it took, with everybody who shared it [s].
        cells: How many shared it.
    """

    inference_s: float
    cells: int


@dataclass(frozen=True)
class Acted:
    """What a policy did with an observation.

    Args:
        steps: Its action.
        made_by: The pass that made it.
    """

    steps: list[ActionStep]
    made_by: Pass


def act_all(due: Sequence[Due]) -> list[Acted | LegatoError]:
    """What each policy does, in the order given; or why one cannot."""
    results: list[Acted | LegatoError | None] = [None] * len(due)
    for members in _group(due):
        started = time.perf_counter()
        done = _act([due[number] for number in members])
        made_by = Pass(time.perf_counter() - started, len(members))
        for number, result in zip(members, done, strict=True):
            failed = isinstance(result, LegatoError)
            results[number] = result if failed else Acted(result, made_by)
    return [result for result in results if result is not None]


def _group(due: Sequence[Due]) -> Iterator[list[int]]:
    """Numbers of the policies that act in one pass: those of one model, others alone."""
    shared: dict[int, list[int]] = {}
    for number, (policy, _) in enumerate(due):
        key = id(policy.model) if isinstance(policy, LearnedPolicy) else -1 - number
        shared.setdefault(key, []).append(number)
    yield from shared.values()


def _act(members: Sequence[Due]) -> list[list[ActionStep] | LegatoError]:
    """Actions of one group; a cell whose frame is wrong does not take the others with it."""
    done: list[list[ActionStep] | LegatoError | None] = []
    seen: list[tuple[LearnedPolicy, StepInput]] = []
    for policy, observation in members:
        try:
            if isinstance(policy, LearnedPolicy):
                seen.append((policy, policy.observe(observation.frame)))
                done.append(None)
            else:
                done.append(policy.act(observation))
        except LegatoError as error:
            done.append(error)
    stepped = iter(step_together(seen) if seen else ())
    return [next(stepped) if each is None else each for each in done]
