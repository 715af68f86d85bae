"""Zenoh sessions with every setting that matters spelled out.

Two profiles: `network` (client of a router; the router itself) and `in_process` (one peer without
links: no port, no discovery, delivery on the publisher's thread).
"""

from __future__ import annotations

import json
import os
import re
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal

import zenoh

from common.bus.access import make_access_control
from common.bus.grants import Grant
from common.bus.tls import Credentials
from common.errors import InvalidValue, PortInUse, RouterRefused, RouterUnreachable
from common.lease import ENCRYPTED_LEASE_S, LOCAL_LEASE_S, LONGEST_LEASE_S, SHORTEST_LEASE_S

Profile = Literal["client", "router", "in_process"]

_ATTEMPT_S = 1.0
_ENCRYPTED = re.compile(r"tls/.+:\d+")
CLOSE_S = 2.0
"""Longer than the usual lease, after which a link that stalls is gone anyway."""
_THREADS = "ZENOH_RUNTIME"
_FEW_THREADS = "(rx: (worker_threads: 1), app: (handover: rx), net: (handover: rx))"
"""Source: zenoh-runtime 1.10, ZRuntime."""


@dataclass(frozen=True)
class BusSettings:
    """Where a session connects and which keys it sees.

    Args:
        profile: `client` of a router, the `router` itself, or `in_process`.
        endpoint: Router address, e.g. `tcp/127.0.0.1:7447`; the router listens there.
        namespace: Deployment or test; prefixes every key, so two of them never meet.
        credentials: Certificate, for an endpoint `tls/...`. A router that has one asks everybody
            for one and lets each role do what `common/bus/access.py` says, in this namespace only.
        grants: Router with credentials: who has the rights of a role in some cells only.
        asked_lease_s: How long a silent link is believed to be alive [s]; see `lease_s`.

    Raises:
        InvalidValue: `tls/...` without credentials, or credentials that would not be used; a lease
            that is too short to tell silence from work, or too long to be of use.
    """

    profile: Profile = "client"
    endpoint: str = "tcp/127.0.0.1:7447"
    namespace: str = "legato"
    credentials: Credentials | None = None
    grants: tuple[Grant, ...] = ()
    asked_lease_s: float | None = None

    def __post_init__(self) -> None:
        if self.credentials is not None:
            # In plain text without a word would be worse.
            if not _ENCRYPTED.fullmatch(self.endpoint):
                raise InvalidValue("--endpoint", self.endpoint, "tls/host:port, because of --certs")
        elif self.endpoint.startswith("tls/"):
            raise InvalidValue("--certs", None, f"the folder of a certificate for {self.endpoint}")
        if not SHORTEST_LEASE_S <= self.lease_s <= LONGEST_LEASE_S:
            expected = f"seconds from {SHORTEST_LEASE_S} to {LONGEST_LEASE_S}"
            raise InvalidValue("--lease-s", self.asked_lease_s, expected)

    @property
    def lease_s(self) -> float:
        """How long a silent link is believed to be alive [s].

        What is asked for, or 1, or 2 with credentials, which is to say between hosts. A process
        that hangs is lost to the others after that long. So is one that a busy machine keeps from
        running: a sign of life is given every quarter of it.
        """
        if self.asked_lease_s is not None:
            return self.asked_lease_s
        return LOCAL_LEASE_S if self.credentials is None else ENCRYPTED_LEASE_S


def _config(settings: BusSettings) -> zenoh.Config:
    mode = {"client": "client", "router": "router", "in_process": "peer"}[settings.profile]
    values: dict[str, object] = {
        "mode": mode,
        # Nothing relies on discovery: multicast is missing in containers and fails silently.
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,
        "adminspace/enabled": False,
        "transport/link/tx/lease": int(1000 * settings.lease_s),
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
    if settings.credentials is not None:
        values |= _encryption(settings.credentials)
        if settings.profile == "router":
            values["access_control"] = make_access_control(settings.namespace, settings.grants)
    config = zenoh.Config()
    for path, value in values.items():
        config.insert_json5(path, json.dumps(value))
    return config


def _encryption(own: Credentials) -> dict[str, object]:
    return {
        "transport/link/tls/root_ca_certificate": str(own.authority),
        "transport/link/tls/listen_certificate": str(own.certificate),
        "transport/link/tls/listen_private_key": str(own.key),
        "transport/link/tls/connect_certificate": str(own.certificate),
        "transport/link/tls/connect_private_key": str(own.key),
        "transport/link/tls/enable_mtls": True,
        "transport/link/tls/verify_name_on_connect": True,
    }


@contextmanager
def open_session(
    settings: BusSettings,
    *,
    stop: threading.Event | None = None,
    wait_s: float = 30.0,
    few_threads: bool = False,
) -> Generator[zenoh.Session]:
    """Open a session and close it in every case (an unclosed one can hang at exit).

    A client tries again in attempts of one second, so that `stop` is obeyed: inside Zenoh's own
    endless wait a signal handler would not run.

    Args:
        settings: Profile, endpoint and namespace.
        stop: Give up quietly waiting once this is set.
        wait_s: How long a client waits for the router [s].
        few_threads: Let Zenoh do what it does in this process on two threads, sending and
            everything else. More threads that wake each other cost up to a quarter of a round trip;
            sending keeps its own, so that signs of life go out also while a callback waits for
            Python. Zenoh reads this once, with the first session; whoever has set `ZENOH_RUNTIME`
            keeps that.

    Raises:
        RouterUnreachable: No router within `wait_s`, or `stop` was set meanwhile.
        RouterRefused: The same for an encrypted endpoint, with what was found there.
        PortInUse: The router's port is taken.
    """
    with _zenoh_threads(few=few_threads):
        session = _open(settings, stop, wait_s)
    try:
        yield session
    finally:
        _close(session)


@contextmanager
def _zenoh_threads(*, few: bool) -> Generator[None]:
    """Ask for few threads, without a trace: a child process may be a router, which needs all."""
    if not few or _THREADS in os.environ:
        yield
        return
    os.environ[_THREADS] = _FEW_THREADS
    try:
        yield
    finally:
        del os.environ[_THREADS]


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
                raise PortInUse("Zenoh router", *_address(settings.endpoint)) from error
            waited_s = time.monotonic() - started
            if waited_s >= wait_s or (stop is not None and stop.is_set()):
                raise _unreachable(settings, waited_s) from error
            # A refused connection fails at once: do not spin.
            (stop or threading.Event()).wait(0.05)


def _unreachable(settings: BusSettings, waited_s: float) -> RouterUnreachable:
    if settings.credentials is None:
        return RouterUnreachable(settings.endpoint, waited_s)
    problem = settings.credentials.find_problem(*_address(settings.endpoint))
    return RouterRefused(settings.endpoint, waited_s, problem)


def _address(endpoint: str) -> tuple[str, int]:
    host, port = endpoint.partition("/")[2].rsplit(":", 1)
    return host.strip("[]"), int(port)
