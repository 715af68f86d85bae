"""Typed publish, subscribe, describe and liveliness on Zenoh."""

from __future__ import annotations

from common.bus.bus import Bus, Subscription
from common.bus.codec import decode, encode
from common.bus.inbox import Handed, Inbox, Received
from common.bus.local import LocalBus
from common.bus.session import BusSettings, open_session
from common.bus.tls import Credentials

__all__ = [
    "Bus",
    "BusSettings",
    "Credentials",
    "Handed",
    "Inbox",
    "LocalBus",
    "Received",
    "Subscription",
    "decode",
    "encode",
    "open_session",
]
