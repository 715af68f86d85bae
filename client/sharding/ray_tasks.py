"""Shards as tasks of Ray: a pool of machines that come and go.

Ray is the extra `ray`. It pickles what goes from one of its processes to another; ours are texts
and numbers only. Who reaches a Ray cluster runs code on it: it belongs in a private network.
"""

from __future__ import annotations

import importlib
import os
import threading
from collections.abc import Sequence
from typing import Any

from client.interrupts import INTERRUPTED
from client.sharding.errors import NoRay, ShardFailed
from client.sharding.run import ShardOrder
from client.sharding.worker import run_order
from common.errors import MissingExtra

RETRIES = 3
"""Of a shard whose worker or machine has died; it goes on where its file ends."""
_LOOK_S = 0.5
_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


def run_on_ray(orders: Sequence[ShardOrder], *, stop: threading.Event) -> bool:
    """Run shards on the cluster that RAY_ADDRESS names, or on this machine without it.

    Every worker needs this installation, and the folder of the shards under the same path.

    Args:
        orders: The shards.
        stop: Ends all of them when set; what has ended stays.

    Returns:
        Whether all of them are complete.

    Raises:
        MissingExtra: Ray is not installed.
        NoRay: RAY_ADDRESS names none.
        ShardFailed: One has ended with an error; the others were stopped.
    """
    # Read when Ray is imported: nothing is told to anybody.
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    try:
        ray: Any = importlib.import_module("ray")
    except ModuleNotFoundError as error:
        raise MissingExtra("ray", "ray") from error
    try:
        ray.init(runtime_env={"env_vars": _ONE_THREAD}, include_dashboard=False)
    except ConnectionError as error:
        raise NoRay(os.environ.get("RAY_ADDRESS", "")) from error
    try:
        task = ray.remote(num_cpus=1, max_retries=RETRIES)(_run)
        running = {task.remote(order.model_dump_json()): order for order in orders}
        codes = _wait_for_all(ray, running, stop)
    finally:
        # With it end the tasks that still run; what they have written stays.
        ray.shutdown()
    return len(codes) == len(orders) and not any(codes)


def _wait_for_all(ray: Any, running: dict[Any, ShardOrder], stop: threading.Event) -> list[int]:
    """Exit codes of the shards that have ended, until all have or it is stopped."""
    codes: list[int] = []
    left = list(running)
    while left and not stop.is_set():
        ended, left = ray.wait(left, timeout=_LOOK_S)
        for task in ended:
            shard = str(running[task].shard)
            try:
                code = ray.get(task)
            except ray.exceptions.RayError as error:
                raise ShardFailed(shard, 1) from error
            if code not in (0, INTERRUPTED):
                raise ShardFailed(shard, code)
            codes.append(code)
    return codes


def _run(order: str) -> int:
    return run_order(ShardOrder.model_validate_json(order), stop=threading.Event())
