"""An encrypted bus with access control, and sessions on it that say and hear what they like."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

from common import messages as m
from common.bus import Bus, BusSettings, Handed, Inbox, Received, open_session
from common.bus.grants import Grant
from common.topics import TOPICS
from tests.certificates import unchecked

WAIT_S = 30.0


def free_port(host: str = "127.0.0.1") -> int:
    with socket.create_server((host, 0)) as probe:
        return probe.getsockname()[1]


def wait_until(condition: Callable[[], bool], *, again: Callable[[], None] = lambda: None) -> None:
    """Wait; `again` says once more what nobody may have subscribed to in time."""
    deadline_s = time.monotonic() + WAIT_S
    while not condition():
        assert time.monotonic() < deadline_s, "waited in vain"
        again()
        time.sleep(0.05)


class Heard(Inbox):
    """Everything that one session was told, never emptied."""

    def __init__(self) -> None:
        super().__init__()
        self.keys: list[str] = []
        self.events: list[object] = []

    def put(self, item: Received | Handed) -> None:
        self.keys.append(item.key)

    def put_event(self, event: object) -> None:
        self.events.append(event)


@dataclass
class Deployment:
    """A router with access control, and whoever joins it."""

    certs: Path
    stack: ExitStack
    port: int = field(default_factory=free_port)
    namespace: str = "lab"

    def settings(self, who: str, *, profile="client", namespace: str | None = None) -> BusSettings:
        return BusSettings(
            profile,
            f"tls/127.0.0.1:{self.port}",
            namespace or self.namespace,
            unchecked(self.certs / who),
        )

    def open_router(self, grants: tuple[Grant, ...] = ()) -> None:
        settings = replace(self.settings("router", profile="router"), grants=grants)
        self.stack.enter_context(open_session(settings))

    def join(self, who: str, *, namespace: str | None = None) -> tuple[Bus, Heard]:
        """A session of a role that asks for everything on every cell."""
        session = open_session(self.settings(who, namespace=namespace), wait_s=WAIT_S)
        bus = self.stack.enter_context(Bus(self.stack.enter_context(session)))
        heard = Heard()
        for topic in TOPICS:
            bus.subscribe(topic, heard)
        return bus, heard


def say(bus: Bus, *messages: m.Message, owner: str = "c") -> None:
    for message in messages:
        bus.publish(message, owner=owner, mode="lockstep")
