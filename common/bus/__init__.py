"""Typed publish, subscribe, describe and liveliness on Zenoh."""

from __future__ import annotations

from common.bus.bus import Bus, Subscription
from common.bus.codec import decode, encode
from common.bus.inbox import Inbox, Received
from common.bus.session import BusSettings, open_session

__all__ = [
    "Bus",
    "BusSettings",
    "Inbox",
    "Received",
    "Subscription",
    "decode",
    "encode",
    "open_session",
]
