"""What a checkpoint says about itself to people: where it comes from and what it can do."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Self

from annotated_types import Ge
from pydantic import AwareDatetime, model_validator

from common.messages.base import Name
from common.statistics import wilson_interval95
from services.policy.learning.checkpoint_config import CheckpointConfig, Share
from services.policy.learning.config import Config
from services.policy.learning.normalization import ActionStatistics

Count = Annotated[int, Ge(0)]


class EvaluationRow(Config, frozen=True):
    """Success of the policy on one robot."""

    robot: Name
    task: Name
    successes: Count
    trials: Count
    low95: Share
    high95: Share
    """Wilson interval of the success rate."""
    conditions: str = ""
    """What was made harder, and which seeds were used."""

    @model_validator(mode="after")
    def _not_more_than_all(self) -> Self:
        if self.successes > self.trials:
            raise ValueError("more successes than trials")
        return self

    @classmethod
    def of(
        cls, *, robot: str, task: str, successes: int, trials: int, conditions: str = ""
    ) -> Self:
        """A row with its interval."""
        low, high = wilson_interval95(successes, trials)
        return cls(
            robot=robot,
            task=task,
            successes=successes,
            trials=trials,
            low95=low,
            high95=high,
            conditions=conditions,
        )


class DatasetSummary(Config, frozen=True):
    """What it was trained on."""

    sha256: str
    episodes: Count
    frames: Count
    robots: tuple[Name, ...]


class CheckpointCard(Config, frozen=True):
    """How a checkpoint was made and how it did. No part of its hash."""

    command: str
    created: AwareDatetime
    versions: dict[str, str]
    git_revision: str | None
    dataset: DatasetSummary
    steps: Count
    """Updates of the weights."""
    timesteps: Count
    """Stereo pairs seen."""
    minutes: Annotated[float, Ge(0)]
    losses: dict[str, float]
    """The last ones, by name."""
    evaluations: tuple[EvaluationRow, ...] = ()


def format_readme(
    name: str,
    sha256: str,
    *,
    config: CheckpointConfig,
    statistics: ActionStatistics,
    card: CheckpointCard,
) -> str:
    """The card as Markdown."""
    network = config.network
    lines = [
        f"# {name}",
        "",
        f"A policy for {', '.join(config.tasks)}: method `{network.method}`, images of "
        f"{config.image.px} px, {network.history.steps} previous actions, actions at "
        f"{config.rate_hz:g} Hz.",
        "",
        *_table(("made", ""), _origin(sha256, config, card)),
        "",
        *_table(("loss", "last value"), ((k, f"{v:.4g}") for k, v in card.losses.items())),
        "",
        "One action at most, as trained: "
        + ", ".join(f"{value:.4g}" for value in statistics.scale)
        + " (m along x, y, z; rad about x, y, z).",
        "",
        "## Evaluations",
        "",
    ]
    if card.evaluations:
        headers = ("task", "robot", "successes", "95 % interval", "conditions")
        lines += _table(headers, (_evaluation(row) for row in card.evaluations))
    else:
        lines.append("None yet: `legato eval --policy` says what it can do.")
    return "\n".join(lines) + "\n"


def _origin(
    sha256: str, config: CheckpointConfig, card: CheckpointCard
) -> Iterable[tuple[str, str]]:
    data = card.dataset
    yield "hash over weights, config, statistics", f"`{sha256}`"
    yield "command", f"`{card.command}`"
    yield "created", card.created.isoformat(timespec="seconds")
    yield "seed", str(config.seed)
    yield "revision", card.git_revision or "not from a repository"
    yield "versions", ", ".join(f"{name} {version}" for name, version in card.versions.items())
    yield (
        "data",
        f"{data.episodes} episodes, {data.frames} frames, {', '.join(data.robots)}, "
        f"`{data.sha256}`",
    )
    yield "training", f"{card.steps} steps, {card.timesteps} frames, {card.minutes:.1f} min"


def _evaluation(row: EvaluationRow) -> tuple[str, ...]:
    interval = f"{row.low95:.1%} – {row.high95:.1%}"
    return row.task, row.robot, f"{row.successes} / {row.trials}", interval, row.conditions


def _table(headers: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> list[str]:
    cells = [headers, ("---",) * len(headers), *rows]
    return ["| " + " | ".join(_escaped(cell) for cell in row) + " |" for row in cells]


def _escaped(cell: str) -> str:
    return cell.replace("|", r"\|")
