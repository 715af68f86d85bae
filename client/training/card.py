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
    from services.policy.training.trainer import UpdateReport, ValidationReport

_PACKAGES = ("torch", "numpy")


def make_card(
    command: list[str],
    origin: DataOrigin,
    *,
    steps: int,
    timesteps: int = 0,
    trained_s: float = 0.0,
    last: UpdateReport | None = None,
    validation: ValidationReport | None = None,
) -> CheckpointCard:
    """What is known of a policy.

    Args:
        command: As it was typed, without the program.
        origin: Of the data.
        steps: Updates of the weights.
        timesteps: Frames seen, repetitions included.
        trained_s: Time spent.
        last: Of the last update.
        validation: On held-out demonstrations.
    """
    from services.policy.learning.checkpoint_card import CheckpointCard, DatasetSummary

    losses: dict[str, float] = {}
    if last is not None:
        losses |= _numbers("", asdict(last))
    if validation is not None:
        losses |= _numbers("validation_", asdict(validation))
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
        steps=steps,
        timesteps=timesteps,
        minutes=round(trained_s / 60.0, 2),
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
