"""What we do around Ray, with a pool that runs tasks one after the other in its place."""

from __future__ import annotations

import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest

from client.interrupts import INTERRUPTED
from client.sharding import ray_tasks
from client.sharding.errors import NoRay, ShardFailed
from client.sharding.run import ShardOrder
from client.sharding.shard import Shard
from common.api import EvaluationRequest
from common.errors import MissingExtra

REQUEST = EvaluationRequest(tasks=["lid"], robots=["abstract"], policies=["expert"], trials=2)


class RayError(Exception):
    """As Ray's own."""


class Pool:
    """Ray's functions that we use."""

    def __init__(self) -> None:
        self.exceptions = SimpleNamespace(RayError=RayError)
        self.is_up = False
        self.done: list[object] = []

    def init(self, **options: object) -> None:
        self.is_up = True

    def shutdown(self) -> None:
        self.is_up = False

    def remote(self, **options: object):
        def wrap(function):
            return SimpleNamespace(remote=lambda argument: (function, argument))

        return wrap

    def wait(self, tasks, *, timeout):
        return tasks[:1], tasks[1:]

    def get(self, task):
        function, argument = task
        self.done.append(argument)
        return function(argument)


@pytest.fixture
def pool(monkeypatch) -> Pool:
    pool = Pool()
    monkeypatch.setitem(sys.modules, "ray", pool)
    return pool


def orders(folder: Path, count: int = 3) -> list[ShardOrder]:
    return [
        ShardOrder(request=REQUEST, shard=Shard(number, count), folder=folder, checkpoints={})
        for number in range(count)
    ]


def answer_with(monkeypatch, *codes: int) -> list[ShardOrder]:
    """Let shards end with these exit codes; what they were asked for."""
    asked: list[ShardOrder] = []
    left = iter(codes)

    def run_order(order: ShardOrder, *, stop: threading.Event) -> int:
        asked.append(order)
        return next(left)

    monkeypatch.setattr(ray_tasks, "run_order", run_order)
    return asked


def test_every_shard_is_a_task(pool, monkeypatch, tmp_path):
    asked = answer_with(monkeypatch, 0, 0, 0)
    assert ray_tasks.run_on_ray(orders(tmp_path), stop=threading.Event())
    assert asked == orders(tmp_path)
    assert not pool.is_up


def test_what_travels_is_text(pool, monkeypatch, tmp_path):
    answer_with(monkeypatch, 0, 0, 0)
    ray_tasks.run_on_ray(orders(tmp_path), stop=threading.Event())
    assert pool.done == [order.model_dump_json() for order in orders(tmp_path)]


def test_a_shard_that_was_interrupted_is_not_complete(pool, monkeypatch, tmp_path):
    answer_with(monkeypatch, 0, INTERRUPTED, 0)
    assert not ray_tasks.run_on_ray(orders(tmp_path), stop=threading.Event())


def test_a_stop_ends_the_tasks(pool, monkeypatch, tmp_path):
    asked = answer_with(monkeypatch)
    stop = threading.Event()
    stop.set()
    assert not ray_tasks.run_on_ray(orders(tmp_path), stop=stop)
    assert asked == []
    assert not pool.is_up


def test_a_shard_that_fails_is_named(pool, monkeypatch, tmp_path):
    answer_with(monkeypatch, 0, 2)
    with pytest.raises(ShardFailed, match="shard 1/3 has ended: exit code 2"):
        ray_tasks.run_on_ray(orders(tmp_path), stop=threading.Event())
    assert not pool.is_up


def test_a_worker_that_died_too_often_is_named(pool, monkeypatch, tmp_path):
    def die(order: ShardOrder, *, stop: threading.Event) -> int:
        raise RayError("the worker died")

    monkeypatch.setattr(ray_tasks, "run_order", die)
    with pytest.raises(ShardFailed, match="shard 0/3"):
        ray_tasks.run_on_ray(orders(tmp_path), stop=threading.Event())


def test_a_cluster_that_is_not_there_is_named(pool, monkeypatch, tmp_path):
    def refuse(**options: object) -> None:
        raise ConnectionError

    pool.init = refuse
    monkeypatch.setenv("RAY_ADDRESS", "nowhere:6379")
    with pytest.raises(NoRay, match="RAY_ADDRESS=nowhere:6379"):
        ray_tasks.run_on_ray(orders(tmp_path), stop=threading.Event())


def test_without_ray_the_extra_is_named(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(MissingExtra, match=r"pip install 'legato\[ray\]'"):
        ray_tasks.run_on_ray(orders(tmp_path), stop=threading.Event())
