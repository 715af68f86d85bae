"""The two ways to run a reactor: as a process, or several of them in one thread."""

from __future__ import annotations

import faulthandler
import logging
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING

from common.bus import Bus, BusSettings, open_session
from common.bus.access import check_node_name
from common.bus.grants import check_cell
from common.errors import AlreadyRunning, RouterUnreachable
from common.health import Heartbeat
from common.host import Host, Sink
from common.metrics import MetricsSettings
from common.reactor import AnyMessage, Reactor

if TYPE_CHECKING:
    from common.metrics.exporter import Exporter

__all__ = [
    "AnyMessage",
    "Host",
    "InlineRunner",
    "Reactor",
    "Sink",
    "install_stop_signals",
    "run_process",
]

log = logging.getLogger(__name__)

SWITCH_INTERVAL_S = 2e-4
"""Python's default of 5 ms lets a busy thread delay Zenoh's receive thread by as much."""
END_S = 20.0
"""More than closing takes on a busy machine; a supervisor or an engine waits less."""


def run_process(
    reactor: Reactor,
    settings: BusSettings,
    *,
    node: str,
    sink: Sink | None = None,
    parent_pid: int | None = None,
    unique: bool = False,
    on_host: Callable[[Host, threading.Event], None] | None = None,
    stop: threading.Event | None = None,
    metrics: MetricsSettings | None = None,
) -> None:
    """Give a reactor to Zenoh as a process and return after SIGTERM or SIGINT.

    Touches the file that `LEGATO_HEARTBEAT` names while it is ready (`common/health.py`).

    Args:
        reactor: The service.
        settings: Where its bus is.
        node: Its name; the liveliness token is `alive/<kind>/<node>`.
        sink: Takes the local messages the reactor returns (results for a database, say).
        parent_pid: Stop when this process is no longer the parent, so that nothing outlives a
            supervisor that was killed.
        unique: Refuse to start beside another node of the same kind.
        on_host: Called with the running host, for edges that hand messages in.
        stop: Ends the loop when set; by default SIGTERM and SIGINT set one of our own.
        metrics: Where Prometheus may ask; nowhere without it.

    Raises:
        RouterUnreachable: No router in time.
        AlreadyRunning: `unique`, and there is one.
        InvalidValue: Access control would silence a node or a cell of this name.
        PortInUse: Something else listens where the metrics are to be.
    """
    if settings.credentials is not None:
        check_node_name(reactor.kind, node)
        check_cell(reactor.owned_cell, settings.credentials.cells)
    cells = ("*",) if settings.credentials is None else settings.credentials.cells
    if stop is None:
        stop = threading.Event()
        install_stop_signals(stop)
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    try:
        with (
            _open_exporter(metrics, reactor, node) as exporter,
            open_session(settings, stop=stop, few_threads=True) as session,
            Bus(session) as bus,
        ):
            if unique:
                _refuse_second(bus, reactor.kind, settings)
            host = Host(reactor, bus, node=node, sink=sink, exporter=exporter, cells=cells)
            host.start()
            log.info("ready", extra={"kind": reactor.kind, "node": node})
            if on_host is not None:
                on_host(host, stop)
            _loop(host, bus, stop, parent_pid)
            log.info("stopping", extra={"kind": reactor.kind, "node": node})
    except RouterUnreachable:
        # Told to stop while it was waiting for a router: not an error.
        if not stop.is_set():
            raise


@contextmanager
def _open_exporter(
    settings: MetricsSettings | None, reactor: Reactor, node: str
) -> Generator[Exporter | None, None, None]:
    if settings is None:
        yield None
        return
    # A server and its packages, for a process that was asked to have one.
    from common.metrics.endpoint import open_exporter

    with open_exporter(settings, reactor, node=node) as exporter:
        yield exporter


def _loop(host: Host, bus: Bus, stop: threading.Event, parent_pid: int | None) -> None:
    heartbeat = Heartbeat.from_environment()
    while not stop.is_set():
        # The longest sleep bounds how fast SIGTERM and a lost parent are noticed.
        host.inbox.wait(min(0.1, host.next_tick_in_s(time.monotonic_ns())))
        host.spin()
        now_ns = time.monotonic_ns()
        host.tick(now_ns)
        if heartbeat is not None and heartbeat.is_due(now_ns) and bus.is_linked:
            heartbeat.beat(now_ns)
        if parent_pid is not None and os.getppid() != parent_pid:
            log.warning("parent is gone, stopping", extra={"parent_pid": parent_pid})
            return


def install_stop_signals(stop: threading.Event, *, end_s: float = END_S) -> None:
    """Let SIGTERM and SIGINT set an event; the loop then ends and closes its session.

    SIGUSR1 writes the stack of every thread to standard error, also while the process hangs in
    native code. A process that is still there `end_s` after it was told to stop does the same and
    ends with exit code 1.

    Args:
        stop: Is set.
        end_s: How long closing may take [s].
    """
    faulthandler.register(signal.SIGUSR1)

    def set_stop(number: int, frame: FrameType | None) -> None:
        stop.set()
        # Needs no Python, which a thread that hangs may hold.
        faulthandler.dump_traceback_later(end_s, exit=True)

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, set_stop)


def _refuse_second(bus: Bus, kind: str, settings: BusSettings) -> None:
    # The token of one that was just lost may live for a lease: look twice.
    for attempt in range(2):
        if not bus.list_alive(kind):
            return
        if attempt == 0:
            time.sleep(settings.lease_s + 0.2)
    raise AlreadyRunning(kind, f"namespace {settings.namespace} at {settings.endpoint}")


class InlineRunner:
    """Several reactors driven from one thread over one session without links."""

    def __init__(self, hosts: Sequence[Host]) -> None:
        self._hosts = tuple(hosts)

    def start(self) -> None:
        """Start every host, in order."""
        for host in self._hosts:
            host.start()

    def run(self, until: Callable[[], bool]) -> None:
        """Spin all hosts in turn until the condition holds."""
        while not until():
            busy = False
            for host in self._hosts:
                busy = host.spin() or busy
            now_ns = time.monotonic_ns()
            for host in self._hosts:
                host.tick(now_ns)
            if not busy:
                time.sleep(min(0.001, *(host.next_tick_in_s(now_ns) for host in self._hosts)))
