"""An evaluation with its trials and pictures, wherever it ran."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from client.api import LegatoClient
from common.api import CellSummary, Evaluation, Trial


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


def to_json(evaluation: Evaluation) -> dict[str, Any]:
    """The result as `legato eval --json` prints it."""
    request = evaluation.request
    return {
        "cells": [cell.model_dump(mode="json", exclude={"done"}) for cell in evaluation.cells],
        "versions": evaluation.versions,
        "seed": request.seed,
        "mode": request.mode,
        "evaluation": evaluation.id,
    }


def describe_success(cell: CellSummary) -> str:
    """Success so far in words, e.g. `96 %  [90-98]`."""
    if cell.success_rate is None:
        return "-"
    low, high = cell.interval95
    return f"{cell.success_rate:.0%} [{100 * low:.0f}-{100 * high:.0f}]".replace("%", " %", 1)


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
