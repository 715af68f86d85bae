"""When a running process beats."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import pytest

from client.deployment import find_free_ports
from common import messages as m
from common.bus import Bus, BusSettings, open_session
from common.health import VARIABLE
from common.service import AnyMessage, Reactor, run_process

WAIT_S = 30.0


class Watch(Reactor):
    """Tells the time: calls back at every tick."""

    kind = "gripper"
    inputs = ()

    def __init__(self, on_tick) -> None:
        self._on_tick = on_tick

    def handle(self, messages: Sequence[AnyMessage]) -> Iterable[AnyMessage]:
        for message in messages:
            if isinstance(message, m.Tick):
                self._on_tick()
        return ()


@pytest.fixture
def path(tmp_path, monkeypatch) -> Iterator[Path]:
    interval_s = sys.getswitchinterval()
    monkeypatch.setenv(VARIABLE, str(tmp_path / "heartbeat"))
    yield tmp_path / "heartbeat"
    sys.setswitchinterval(interval_s)


def wait_until(condition) -> None:
    pause = threading.Event()
    for _ in range(int(WAIT_S / 0.01)):
        if condition():
            return
        pause.wait(0.01)
    raise AssertionError("waited in vain")


def test_a_process_with_a_router_beats(path):
    endpoint = f"tcp/127.0.0.1:{find_free_ports(1)[0]}"
    stop = threading.Event()
    ticks: list[bool] = []

    def look() -> None:
        ticks.append(path.exists())
        if ticks[-1] or len(ticks) > 100:
            stop.set()

    with open_session(BusSettings(profile="router", endpoint=endpoint)):
        run_process(Watch(look), BusSettings(endpoint=endpoint), node="watch", stop=stop)
    assert ticks[0] is False
    assert ticks[-1] is True


def test_a_process_without_a_router_does_not_beat(path):
    stop = threading.Event()
    ticks: list[bool] = []

    def look() -> None:
        ticks.append(path.exists())
        if len(ticks) == 3:
            stop.set()

    run_process(Watch(look), BusSettings("in_process"), node="watch", stop=stop)
    assert ticks == [False, False, False]


def test_the_bus_knows_whether_it_has_a_router():
    endpoint = f"tcp/127.0.0.1:{find_free_ports(1)[0]}"
    router = BusSettings(profile="router", endpoint=endpoint)
    with (
        open_session(router) as first,
        open_session(BusSettings(endpoint=endpoint)) as session,
        Bus(session) as bus,
    ):
        assert bus.is_linked
        first.close()
        wait_until(lambda: not bus.is_linked)
        with open_session(router):
            wait_until(lambda: bus.is_linked)
