"""Metrics as Prometheus reads them: over HTTP, from a running node."""

from __future__ import annotations

import argparse
import socket
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence

import httpx
import pytest
from prometheus_client.parser import text_string_to_metric_families

from common import messages as m
from common.bus import BusSettings
from common.errors import InvalidValue, PortInUse
from common.metrics import METRICS, MetricsSettings, Sample
from common.metrics import table as t
from common.metrics.endpoint import open_exporter
from common.metrics.exporter import Exporter
from common.process import METRICS_HOST, METRICS_PORT, add_bus_options, metrics_settings
from common.service import AnyMessage, Reactor, run_process
from tests.metrics_scrape import Scrape, scrape


class Arm(Reactor):
    """A retargeter that measures one solve per tick, and does what the test wants meanwhile."""

    kind = "retarget"
    inputs = (m.RobotState,)

    def __init__(self, on_tick: Callable[[], None] = lambda: None) -> None:
        self._on_tick = on_tick

    @property
    def tick_period_s(self) -> float:
        return 0.01

    def handle(self, messages: Sequence[AnyMessage]) -> Iterable[AnyMessage]:
        self._on_tick()
        return ()

    def measure(self, given, returned, began_ns) -> Iterable[Sample]:
        return [Sample(t.SOLVE, 0.0015, ("panda",))]

    def levels(self) -> Iterable[Sample]:
        return [Sample(t.LIMITED_TICKS, 7, ("panda",)), Sample(t.LIMITED_TICKS, 0, ("spot",))]


@pytest.fixture
def switch_interval() -> Iterator[None]:
    interval_s = sys.getswitchinterval()
    yield
    sys.setswitchinterval(interval_s)


@pytest.fixture
def port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return probe.getsockname()[1]


@pytest.mark.usefixtures("switch_interval")
def test_a_process_offers_what_it_counts_and_measures(port: int):
    stop = threading.Event()
    seen: list[Scrape] = []
    ticks = iter(range(1000))

    def look() -> None:
        if next(ticks) == 3:
            # The server answers on a thread of its own: also while the worker is busy.
            seen.append(scrape(port))
            stop.set()

    run_process(
        Arm(look),
        BusSettings("in_process"),
        node="arm",
        stop=stop,
        metrics=MetricsSettings(port=port),
    )
    (found,) = seen
    assert found.value(t.NODE_INFO, kind="retarget") == 1
    assert found.count(t.SOLVE, robot="panda") == 3
    assert found.count(t.HANDLE) == 3
    assert found.value(t.LIMITED_TICKS, robot="panda") == 7
    assert found.value(t.LIMITED_TICKS, robot="spot") == 0
    assert found.value(t.PUBLISHED, topic="metrics") == 1
    # Nothing came yet; a rate needs the 0 from which it rises.
    for metric in (t.RECEIVED, t.REJECTED, t.STALE, t.MISSING, t.SUPERSEDED, t.WAITING):
        assert found.value(metric, topic="robot/state") == 0
    assert found.raw("process_resident_memory_bytes") > 1e6
    assert all(labels["node"] == "arm" for labels in found.labels("legato_"))
    with pytest.raises(httpx.ConnectError):
        scrape(port)


def test_a_taken_port_is_refused_before_anything_starts():
    with socket.create_server(("127.0.0.1", 0)) as server:
        taken = MetricsSettings(port=server.getsockname()[1])
        with pytest.raises(PortInUse, match="metrics"):
            run_process(
                Arm(), BusSettings("in_process"), node="a", stop=threading.Event(), metrics=taken
            )


def test_an_address_of_another_machine_is_refused():
    settings = MetricsSettings(port=0, host="192.0.2.1")
    with (
        pytest.raises(InvalidValue, match="--metrics-host"),
        open_exporter(settings, Arm(), node="a"),
    ):
        pass


def test_two_nodes_of_one_process_do_not_share_their_metrics():
    first, second = Exporter(Arm(), node="a"), Exporter(Arm(), node="b")
    first.handled([], [], took_ns=1000)
    name = f"{t.HANDLE.name}_count"
    assert first.registry.get_sample_value(name, {"node": "a"}) == 1
    assert second.registry.get_sample_value(name, {"node": "b"}) == 0


def options(*arguments: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_bus_options(parser, default_node="a")
    return parser.parse_args(arguments)


def test_without_an_option_there_is_no_listener(monkeypatch):
    monkeypatch.delenv(METRICS_PORT, raising=False)
    monkeypatch.delenv(METRICS_HOST, raising=False)
    assert metrics_settings(options()) is None
    given = metrics_settings(options("--metrics-port=9464"))
    assert given == MetricsSettings(port=9464, host="127.0.0.1")


def test_containers_are_told_by_their_environment(monkeypatch):
    monkeypatch.setenv(METRICS_PORT, "9464")
    monkeypatch.setenv(METRICS_HOST, "0.0.0.0")
    assert metrics_settings(options()) == MetricsSettings(port=9464, host="0.0.0.0")
    given = metrics_settings(options("--metrics-port=1", "--metrics-host=127.0.0.1"))
    assert given == MetricsSettings(port=1, host="127.0.0.1")


def test_a_port_that_cannot_be_is_refused():
    with pytest.raises(InvalidValue, match="--metrics-port"):
        metrics_settings(options("--metrics-port=65536"))


def test_text_is_what_prometheus_parses(port: int):
    with open_exporter(MetricsSettings(port=port), Arm(), node="arm"):
        text = httpx.get(f"http://127.0.0.1:{port}/metrics").text
    families = {family.name for family in text_string_to_metric_families(text)}
    own = {each.name.removesuffix("_total") for each in METRICS if each.belongs_to("retarget")}
    # Totals of the reactor follow with its first heartbeat.
    assert own - families == {
        "legato_foreign_messages",
        "legato_limited_ticks",
        "legato_solver_failures",
    }
    assert not [name for name in families if name.endswith("_created")]
