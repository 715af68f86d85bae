"""`legato eval --shard`, `legato eval --workers [--ray]` and `legato eval merge`."""

from __future__ import annotations

import sys
import threading
from pathlib import Path

from client.commands import Eval, EvalMerge
from client.interrupts import INTERRUPTED, postpone_interrupts
from client.progress import open_progress
from client.request import build_request
from client.sharding.merge import merge_shards
from client.sharding.ray_tasks import run_on_ray
from client.sharding.run import ShardOrder, ShardSummary, run_shard
from client.sharding.shard import MAX_SHARDS, Shard
from client.sharding.workers import run_workers
from client.verbs.evaluate import conclude, name_folders
from common.errors import InvalidValue


def run_shards(command: Eval) -> int:
    """Run one shard, or all of them in as many processes and show the results."""
    named, checkpoints = name_folders(command)
    request = build_request(named, pictures=command.pictures or command.report is not None)
    folder = (command.out or Path()).absolute()
    orders = [
        ShardOrder(request=request, shard=shard, folder=folder, checkpoints=checkpoints)
        for shard in _choose_shards(command)
    ]
    stop = threading.Event()
    with postpone_interrupts(stop):
        if command.shard is None:
            run_all = run_on_ray if command.ray else run_workers
            complete = run_all(orders, stop=stop)
        else:
            summary = run_shard(orders[0], open_display=open_progress, stop=stop)
            complete = summary.done == summary.trials
            sys.stdout.write(describe_shard(orders[0].shard, summary) + "\n")
    if not complete:
        sys.stderr.write("interrupted; run the same command again to go on\n")
        return INTERRUPTED
    if command.shard is None:
        conclude(command, merge_shards(folder))
    return 0


def merge(command: EvalMerge) -> int:
    """Show the results of an evaluation whose shards have all been run."""
    conclude(command, merge_shards(command.folder))
    return 0


def describe_shard(shard: Shard, summary: ShardSummary) -> str:
    """How far a shard is, in one line."""
    words = f"{summary.path}: shard {shard}, {summary.done} of {summary.trials} trials"
    if summary.before == summary.trials:
        return f"{words}; it was complete, nothing was run"
    return f"{words}, {summary.before} of them from before" if summary.before else words


def _choose_shards(command: Eval) -> list[Shard]:
    """The shards that this command runs.

    Raises:
        InvalidValue: There is no such shard, or no such number of processes.
    """
    if command.shard is not None:
        return [Shard.parse(command.shard)]
    count = command.workers or 0
    if not 1 <= count <= MAX_SHARDS:
        raise InvalidValue("--workers", count, f"1 to {MAX_SHARDS}")
    return [Shard(number, count) for number in range(count)]
