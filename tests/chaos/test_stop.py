"""SIGTERM ends a process whatever the state of its link."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from client.deployment import HOST
from client.supervisor import GRACE_S
from common.bus import Bus, BusSettings, open_session
from tests.chaos.cable import Cable
from tests.chaos.system import find_server_ports
from tests.chaos.waiting import wait_until

pytestmark = [pytest.mark.processes, pytest.mark.long]


@contextmanager
def spawned(module: str, *arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen(
        [sys.executable, "-m", module, *arguments], stderr=subprocess.DEVNULL
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


Router = subprocess.Popen[bytes]

STATES: dict[str, Callable[[Cable, Router], None]] = {
    "well": lambda _cable, _router: None,
    "stalled": lambda cable, _router: cable.stall(),
    "unplugged": lambda cable, _router: cable.unplug(),
    "router stopped": lambda _cable, router: router.send_signal(signal.SIGSTOP),
    "router killed": lambda _cable, router: router.kill(),
}


@pytest.mark.parametrize("state", STATES)
def test_sigterm_ends_a_process_with_its_link_in_any_state(state: str, tmp_path):
    router_port, cable_port, rest_port = find_server_ports(3)
    with (
        spawned("services.router", f"--listen={HOST}:{router_port}") as router,
        Cable(cable_port, router_port) as cable,
        spawned(
            "services.control",
            f"--endpoint=tcp/{HOST}:{cable_port}",
            f"--port={rest_port}",
            f"--data={tmp_path}",
        ) as process,
    ):
        settings = BusSettings(endpoint=f"tcp/{HOST}:{router_port}")
        with open_session(settings) as session, Bus(session) as bus:
            wait_until(lambda: bus.list_alive("control"), deadline_s=60.0)
        STATES[state](cable, router)
        process.send_signal(signal.SIGTERM)
        # As long as the supervisor waits; Zenoh alone would wait for 10 s.
        assert process.wait(GRACE_S) == 0
