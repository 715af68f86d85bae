"""Messages of a node that an episode does not name, and what a service makes of them."""

from __future__ import annotations

from typing import TypeVar

import pytest

from common.messages import Message
from common.metrics.table import FOREIGN
from common.reactor import Reactor

STRANGER = "stranger"

AnyKind = TypeVar("AnyKind", bound=Message)


def by_stranger(message: AnyKind) -> AnyKind:
    """The same message from somebody else."""
    header = message.header
    return message.stamped(source=STRANGER, seq=header.seq, t_mono_ns=header.t_mono_ns)


def strangers_told(caplog: pytest.LogCaptureFixture) -> list[str]:
    """Foreign nodes in the log, a name per line."""
    told = (getattr(record, "from_node", None) for record in caplog.records)
    return [name for name in told if name is not None]


def dropped(reactor: Reactor) -> dict[str, float]:
    """Foreign messages that a service has counted, by topic."""
    return {each.labels[0]: each.value for each in reactor.levels() if each.metric is FOREIGN}
