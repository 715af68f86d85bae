"""The shards of a folder as one evaluation."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from client.record import EvaluationRecord
from client.sharding.errors import NoShards, ShardsMissing
from client.sharding.folder import check_alike, check_apart, read_headers
from client.sharding.header import ShardHeader
from client.sharding.record import ShardRecord, read_shard
from common.api import Evaluation, Trial
from services.control.grid import expand_grid
from services.control.summary import TrialFacts, measurements_of, summarise


def merge_shards(folder: Path) -> EvaluationRecord:
    """Read the shards of an evaluation and give what a single run of it would have given.

    Args:
        folder: What was given as `--out`.

    Raises:
        BadShard: A file is damaged.
        NoShards: The folder has none.
        ShardsDiffer: They are not of one evaluation.
        ShardsMissing: Not all are there and complete.
        ShardsOverlap: Two files hold one shard.
    """
    headers = read_headers(folder)
    if not headers:
        raise NoShards(str(folder))
    path, first = next(iter(headers.items()))
    check_alike(headers, str(path), first)
    check_apart(headers)
    grid = expand_grid(first.evaluation, first.origin.request)
    records = [record for path in headers if (record := read_shard(path)) is not None]
    for record in records:
        record.check_trials(grid)
    _check_complete(folder, records, count=first.count, total=len(grid))
    return _join(records)


def _check_complete(
    folder: Path, records: Sequence[ShardRecord], *, count: int, total: int
) -> None:
    unfinished: dict[int, tuple[int, int]] = {}
    absent = set(range(count))
    for record in records:
        shard = record.header.shard
        absent.remove(shard.number)
        done, all_of_it = len(record.trials), len(shard.trials(total))
        if done < all_of_it:
            unfinished[shard.number] = done, all_of_it
    if absent or unfinished:
        raise ShardsMissing(str(folder), count=count, absent=sorted(absent), unfinished=unfinished)


def _join(records: Sequence[ShardRecord]) -> EvaluationRecord:
    record_of = {trial.id: record for record in records for trial in record.trials}
    trials = sorted((t for record in records for t in record.trials), key=lambda trial: trial.id)
    return EvaluationRecord(
        evaluation=_summarise([record.header for record in records], trials),
        trials=trials,
        picture=lambda trial, name: record_of[trial.id].picture(trial.id, name),
    )


def _summarise(headers: Sequence[ShardHeader], trials: Sequence[Trial]) -> Evaluation:
    origin, request = headers[0].origin, headers[0].origin.request
    ends = [attempt.finished_at for trial in trials for attempt in trial.attempts]
    cells = summarise(
        request,
        (
            TrialFacts(t.task, t.robot, t.policy, t.index, t.status, **measurements_of(t.result))
            for t in trials
        ),
    )
    return Evaluation(
        id=headers[0].evaluation,
        status="done",
        request=request,
        created_at=min(header.created_at for header in headers),
        finished_at=max((end for end in ends if end is not None), default=None),
        trials_total=len(trials),
        trials_done=len(trials),
        waiting_for=[],
        cells=cells,
        versions=origin.versions,
    )
