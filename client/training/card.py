"""The card of a trained policy: from which command, data and code it comes."""

from __future__ import annotations

import importlib.metadata
import platform
import shlex
import subprocess
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from common import __version__

if TYPE_CHECKING:
    from services.policy.learning.checkpoint_card import CheckpointCard
    from services.policy.training.data import DataOrigin
    from services.policy.training.run import RunResult

_PACKAGES = ("torch", "numpy")


def make_card(
    command: list[str], origin: DataOrigin, result: RunResult, *, timesteps_per_update: int
) -> CheckpointCard:
    """What is known when the training ends.

    Args:
        command: As it was typed.
        origin: Of the data.
        result: Of the run.
        timesteps_per_update: Frames of an update.
    """
    from services.policy.learning.checkpoint_card import CheckpointCard, DatasetSummary

    losses: dict[str, float] = {}
    if result.last is not None:
        losses |= _numbers("", asdict(result.last))
    if result.validation is not None:
        losses |= _numbers("validation_", asdict(result.validation))
    return CheckpointCard(
        command=shlex.join(["legato", *command]),
        created=datetime.now(UTC).replace(microsecond=0),
        versions={
            "legato": __version__,
            "python": platform.python_version(),
            **{name: importlib.metadata.version(name) for name in _PACKAGES},
        },
        git_revision=find_revision(),
        dataset=DatasetSummary(
            sha256=origin.sha256,
            episodes=origin.episodes,
            frames=origin.rows,
            robots=origin.robots,
        ),
        steps=result.update,
        timesteps=result.update * timesteps_per_update,
        minutes=round(result.trained_s / 60.0, 2),
        losses=losses,
    )


def find_revision() -> str | None:
    """Commit of the code, or None where it is not run from a checkout."""
    asked = ("git", "-C", str(Path(__file__).parent), "rev-parse", "HEAD")
    try:
        said = subprocess.run(asked, capture_output=True, text=True, check=False, timeout=10)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return said.stdout.strip() if said.returncode == 0 else None


def _numbers(prefix: str, fields: dict[str, float | None]) -> dict[str, float]:
    return {prefix + name: value for name, value in fields.items() if value is not None}
