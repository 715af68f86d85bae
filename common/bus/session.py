"""Zenoh sessions with every setting that matters spelled out.

Two profiles: `network` (client of a router; the router itself) and `in_process` (one peer without
links: no port, no discovery, delivery on the publisher's thread).
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal

import zenoh

from common.errors import PortInUse, RouterUnreachable

Profile = Literal["client", "router", "in_process"]

_ATTEMPT_S = 1.0
CLOSE_S = 2.0
"""Longer than the lease of 1 s, after which a link that stalls is gone anyway."""


@dataclass(frozen=True)
class BusSettings:
    """Where a session connects and which keys it sees.

    Args:
        profile: `client` of a router, the `router` itself, or `in_process`.
        endpoint: Router address, e.g. `tcp/127.0.0.1:7447`; the router listens there.
        namespace: Deployment or test; prefixes every key, so two of them never meet.
    """

    profile: Profile = "client"
    endpoint: str = "tcp/127.0.0.1:7447"
    namespace: str = "legato"


def _config(settings: BusSettings) -> zenoh.Config:
    mode = {"client": "client", "router": "router", "in_process": "peer"}[settings.profile]
    values: dict[str, object] = {
        "mode": mode,
        # Nothing relies on discovery: multicast is missing in containers and fails silently.
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,
        "transport/link/tx/lease": 1000,
        # The default of 5 s lets one stalled subscriber freeze the simulation.
        "transport/link/tx/queue/congestion_control/block/wait_before_close": 500_000,
        "transport/shared_memory/enabled": False,
        "namespace": settings.namespace,
    }
    if settings.profile == "client":
        values |= {
            "connect/endpoints": [settings.endpoint],
            "connect/timeout_ms": int(1000 * _ATTEMPT_S),
            "connect/retry": {
                "period_init_ms": 50,
                "period_max_ms": 200,
                "period_increase_factor": 1.5,
            },
            "listen/endpoints": [],
        }
    elif settings.profile == "router":
        # A router has no namespace: it relays the keys of every deployment.
        del values["namespace"]
        values["listen/endpoints"] = [settings.endpoint]
    else:
        values["listen/endpoints"] = []
        values["connect/endpoints"] = []
    config = zenoh.Config()
    for path, value in values.items():
        config.insert_json5(path, json.dumps(value))
    return config


@contextmanager
def open_session(
    settings: BusSettings, *, stop: threading.Event | None = None, wait_s: float = 30.0
) -> Generator[zenoh.Session]:
    """Open a session and close it in every case (an unclosed one can hang at exit).

    A client tries again in attempts of one second, so that `stop` is obeyed: inside Zenoh's own
    endless wait a signal handler would not run.

    Args:
        settings: Profile, endpoint and namespace.
        stop: Give up quietly waiting once this is set.
        wait_s: How long a client waits for the router [s].

    Raises:
        RouterUnreachable: No router within `wait_s`, or `stop` was set meanwhile.
        PortInUse: The router's port is taken.
    """
    session = _open(settings, stop, wait_s)
    try:
        yield session
    finally:
        _close(session)


def _close(session: zenoh.Session) -> None:
    """Close a session, but do not wait for a link that stalls: Zenoh would for 10 s."""
    closing = threading.Thread(target=session.close, name="close")
    closing.start()
    closing.join(CLOSE_S)


def _open(settings: BusSettings, stop: threading.Event | None, wait_s: float) -> zenoh.Session:
    started = time.monotonic()
    while True:
        try:
            return zenoh.open(_config(settings))
        except zenoh.ZError as error:
            if settings.profile == "router":
                host, port = settings.endpoint.partition("/")[2].rsplit(":", 1)
                raise PortInUse("Zenoh router", host, int(port)) from error
            waited_s = time.monotonic() - started
            if waited_s >= wait_s or (stop is not None and stop.is_set()):
                raise RouterUnreachable(settings.endpoint, waited_s) from error
            # A refused connection fails at once: do not spin.
            (stop or threading.Event()).wait(0.05)
