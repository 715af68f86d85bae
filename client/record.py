"""An evaluation with its trials and pictures, wherever it ran."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from client.api import LegatoClient
from common.api import CellSummary, Evaluation, StageCounts, Trial
from common.messages import STAGES, StagesReached


@dataclass(frozen=True)
class EvaluationRecord:
    """What tables and reports are made from.

    Args:
        evaluation: The evaluation as it ended.
        trials: Its trials in order.
        picture: Gives a picture as PNG: trial and name.
    """

    evaluation: Evaluation
    trials: list[Trial]
    picture: Callable[[Trial, str], bytes]


def load_record(client: LegatoClient, identifier: str) -> EvaluationRecord:
    """Fetch an evaluation from a control plane; pictures are fetched when they are asked for."""
    return EvaluationRecord(
        evaluation=client.evaluation(identifier),
        trials=client.trials(identifier),
        picture=lambda trial, name: client.picture(identifier, trial.id, name),
    )


def to_json(record: EvaluationRecord) -> dict[str, Any]:
    """The result as `legato eval --json` prints it."""
    evaluation = record.evaluation
    request = evaluation.request
    return {
        "cells": [cell.model_dump(mode="json", exclude={"done"}) for cell in evaluation.cells],
        "trials": [_trial_to_json(trial) for trial in record.trials],
        "versions": evaluation.versions,
        "seed": request.seed,
        "mode": request.mode,
        "evaluation": evaluation.id,
    }


def _trial_to_json(trial: Trial) -> dict[str, Any]:
    named = {"task", "robot", "policy", "index", "seed", "status", "reason"}
    stages = None if trial.stages is None else trial.stages.model_dump()
    return {**trial.model_dump(mode="json", include=named), "stages": stages}


def describe_success(cell: CellSummary) -> str:
    """Success so far in words, e.g. `96 %  [90-98]`."""
    if cell.success_rate is None:
        return "-"
    return describe_rate(cell.success_rate, cell.interval95)


def describe_rate(rate: float, interval95: tuple[float, float]) -> str:
    """A rate with its interval in words, e.g. `96 % [90-98]`."""
    low, high = interval95
    return f"{100 * rate:.0f} % [{100 * low:.0f}-{100 * high:.0f}]"


def count_stages(stages: StageCounts) -> str:
    """Trials that reached each of `STAGES`, e.g. `20/19/18/18`."""
    return "/".join(str(getattr(stages, stage)) for stage in STAGES)


def describe_stages(stages: StagesReached | None) -> str:
    """The stages that a trial reached, e.g. `grasped, lifted`."""
    if stages is None:
        return "-"
    return ", ".join(stages.names) or "nothing"


def in_mm(value_m: float | None) -> str:
    """Metres as millimetres for a table."""
    return "-" if value_m is None else f"{1e3 * value_m:.1f}"


def in_ms(value_s: float | None) -> str:
    """Seconds as milliseconds for a table."""
    return "-" if value_s is None else f"{1e3 * value_s:.2f}"


def in_percent(share: float | None) -> str:
    """A share as per cent for a table."""
    return "-" if share is None else f"{100 * share:.1f}"


def as_factor(value: float | None) -> str:
    """A real-time factor for a table."""
    return "-" if value is None else f"{value:.1f}x"
