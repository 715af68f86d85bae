"""Runs what is missing of a shard."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from client.album import may_be_shown
from client.offline import check_request_here, load_library, missing_extra_told, run_trials
from client.progress import Progress
from client.sharding.header import ShardHeader, describe_origin
from client.sharding.shard import Shard
from client.sharding.writer import open_shard
from common.api import EvaluationRequest, Trial
from services.control.grid import expand_grid


class ShardOrder(BaseModel):
    """A shard to run."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    request: EvaluationRequest
    """The whole grid."""
    shard: Shard
    folder: Path
    """Where its file is."""
    checkpoints: dict[str, Path]
    """Folders of policies that do not come with LEGATO, by name."""


@dataclass(frozen=True)
class ShardSummary:
    """How far a shard is.

    Args:
        path: Its file.
        trials: Trials that belong to it.
        before: Those that had ended before.
        done: Those that have ended now.
    """

    path: Path
    trials: int
    before: int
    done: int


def run_shard(
    order: ShardOrder, *, open_display: Callable[[], Progress], stop: threading.Event
) -> ShardSummary:
    """Run the trials of a shard that have not ended yet; each is on the disk when it has ended.

    Args:
        order: Which shard.
        open_display: Gives a display of progress; called if there is something to run.
        stop: Ends the run when set; what has ended stays.

    Raises:
        CheckpointError: A policy's checkpoint cannot be used.
        InvalidValue: The grid is too large.
        MissingExtra: A package that some service needs is not installed.
        StoreError: The folder cannot be used, see `open_shard`.
        UnknownNames: Tasks, robots or policies that do not exist.
        UntrainedTask: A policy was not trained for a task.
    """
    with missing_extra_told():
        check_request_here(order.request, checkpoints=order.checkpoints)
        library = load_library(order.request, checkpoints=order.checkpoints)
        origin = describe_origin(order.request, library)
    header = ShardHeader(
        number=order.shard.number,
        count=order.shard.count,
        digest=origin.digest,
        origin=origin,
        created_at=datetime.now(UTC),
    )
    grid = expand_grid(header.evaluation, order.request)
    trials = len(order.shard.trials(len(grid)))
    with open_shard(order.folder, header, grid) as writer:
        before = trials - len(writer.missing)

        def keep(trial: Trial, pictures: Mapping[str, bytes]) -> None:
            writer.append(trial, pictures if may_be_shown(trial) else {})

        if writer.missing:
            only = frozenset(writer.missing)
            with open_display() as progress:
                run_trials(
                    order.request,
                    library=library,
                    progress=progress,
                    stop=stop,
                    only=only,
                    keep=keep,
                )
        return ShardSummary(writer.path, trials, before, trials - len(writer.missing))
