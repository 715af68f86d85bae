"""One reactor on a bus."""

from __future__ import annotations

import importlib.metadata
import logging
import os
import socket
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeAlias

from common import __version__
from common.bus import Bus, Handed, Inbox, Received, Subscription, decode
from common.bus.bus import DescribeRequest
from common.episode_log import EpisodeLog
from common.errors import ContractError, ForeignMessage
from common.messages import (
    ONLY_CELLS,
    AskDescription,
    EpisodeAbort,
    EpisodeConfigure,
    Header,
    LocalMessage,
    Message,
    Mode,
    NodeDescription,
    NodeMetrics,
    Tick,
)
from common.metrics import Tally
from common.reactor import AnyMessage, Reactor
from common.topics import Topic, topic_of, topics_of

if TYPE_CHECKING:
    from common.metrics.exporter import Exporter

log = logging.getLogger(__name__)

Sink: TypeAlias = Callable[[LocalMessage], None]

HEARTBEAT_NS = 1_000_000_000


class Host:
    """One reactor on a bus: it receives, decodes, fences epochs, stamps, publishes and counts.

    Args:
        reactor: The service.
        bus: Where it speaks and hears.
        node: Its name.
        sink: Takes the local messages that the reactor returns.
        exporter: Is told everything that is measured.
        cells: Cells in which it has rights, which its description says.
    """

    def __init__(
        self,
        reactor: Reactor,
        bus: Bus,
        *,
        node: str,
        sink: Sink | None = None,
        exporter: Exporter | None = None,
        cells: Sequence[str] = ("*",),
    ) -> None:
        self.reactor = reactor
        self.node = node
        self.inbox = Inbox()
        self._bus = bus
        self._sink = sink
        self._epochs: dict[str, int] = {}
        self._modes: dict[str, Mode] = {}
        self._sequence: defaultdict[tuple[str, str], int] = defaultdict(int)
        self._last_seen: dict[tuple[str, str, str], int] = {}
        self._complained: set[tuple[str, str]] = set()
        self._followed: dict[str, tuple[Subscription, ...]] = {}
        self._next_tick_ns = 0
        self._next_beat_ns = 0
        self._tally = Tally()
        self._episodes = EpisodeLog()
        self._exporter = exporter
        self._cells = tuple(cells)
        if exporter is not None:
            exporter.watch(self._tally, self.inbox)
        self._started_unix_s = time.time()

    def start(self) -> None:
        """Subscribe, then declare the liveliness token: from here on the node is ready."""
        for topic in topics_of(self.reactor.inputs):
            if not self._is_followed(topic):
                owner = self.reactor.owned_cell if topic.scope == "cell" else None
                self._bus.subscribe(topic, self.inbox, owner=owner or "*")
        self._bus.serve_description(self.node, self.inbox)
        if self.reactor.watches_nodes:
            self._bus.watch_alive(self.inbox)
        self._bus.declare_alive(self.reactor.kind, self.node)

    def spin(self) -> bool:
        """Handle everything that waits; tell whether there was anything."""
        events, received = self.inbox.drain()
        if not events and not received:
            return False
        messages: list[AnyMessage] = []
        for event in events:
            if isinstance(event, DescribeRequest):
                event.answer(self.describe())
            else:
                messages.append(event)
        for item in received:
            message = self._accept(item)
            if message is not None:
                messages.append(message)
        if messages:
            self._handle(messages)
        return True

    def tick(self, now_ns: int) -> None:
        """Hand the reactor a `Tick` and send a heartbeat, each when due."""
        if now_ns >= self._next_tick_ns:
            self._next_tick_ns = now_ns + int(self.reactor.tick_period_s * 1e9)
            self._handle([Tick(now_ns)])
        if now_ns >= self._next_beat_ns:
            self._next_beat_ns = now_ns + HEARTBEAT_NS
            self._publish(self.metrics())
            if self._exporter is not None:
                self._exporter.note_levels()

    def next_tick_in_s(self, now_ns: int) -> float:
        """Time until the reactor wants its next `Tick` [s]."""
        return max(0.0, (self._next_tick_ns - now_ns) * 1e-9)

    def describe(self) -> NodeDescription:
        """What this node is and offers."""
        return NodeDescription(
            header=Header(source=self.node),
            kind=self.reactor.kind,
            node=self.node,
            code_version=__version__,
            packages={name: importlib.metadata.version(name) for name in self.reactor.packages},
            host=socket.gethostname(),
            pid=os.getpid(),
            started_unix_s=self._started_unix_s,
            offers=self._offers(),
            checkpoints=dict(self.reactor.checkpoints()),
        )

    def _offers(self) -> dict[str, list[str]]:
        limits = {} if "*" in self._cells else {ONLY_CELLS: list(self._cells)}
        return {**self.reactor.offers(), **limits}

    def metrics(self) -> NodeMetrics:
        """Counters since the start."""
        return NodeMetrics(
            header=Header(source=self.node),
            node=self.node,
            handled=self._tally.handled,
            published=sum(self._tally.published.values()),
            rejected=sum(self._tally.rejected.values()),
            superseded=self.inbox.superseded,
            stale=sum(self._tally.stale.values()),
            gaps=sum(self._tally.missing.values()),
            handle_time_s=self._tally.handle_ns * 1e-9,
        )

    def ask_description(self, node: str) -> None:
        """Ask another node what it is; the answer arrives as a `NodeDescription`."""
        self._bus.ask_description(node, self.inbox)

    def _is_followed(self, topic: Topic) -> bool:
        """Whether a topic is subscribed per cell, from the episodes that concern the reactor.

        A process that heard the data of every cell would be woken a hundred times a second for
        each of them, only to drop it.
        """
        return (
            topic.scope == "cell"
            and not topic.is_control
            and EpisodeConfigure in self.reactor.inputs
            and self.reactor.owned_cell is None
        )

    def _follow(self, cell: str) -> None:
        """Subscribe to a cell's data while the reactor serves it.

        Done before the answer to the configuration leaves, so that the start finds the
        subscriptions in place.
        """
        followed = self._followed.pop(cell, ())
        if self.reactor.serves(cell):
            topics = [t for t in topics_of(self.reactor.inputs) if self._is_followed(t)]
            self._followed[cell] = followed or tuple(
                self._bus.subscribe(topic, self.inbox, owner=cell) for topic in topics
            )
        else:
            for subscription in followed:
                self._bus.unsubscribe(subscription)

    def _accept(self, item: Received | Handed) -> Message | None:
        """Decode one message, or count why it is not for the reactor."""
        topic = item.topic
        of_cell = topic.scope == "cell"
        if of_cell and not topic.is_control and not self.reactor.serves(item.owner):
            return None
        message = item.message if isinstance(item, Handed) else self._decode(item)
        if message is None:
            return None
        if topic.is_fenced and not self._is_current(message):
            self._tally.stale[topic.name] += 1
            return None
        self._tally.received[topic.name] += 1
        self._count_gap(topic.name, message.header)
        return message

    def _decode(self, item: Received) -> Message | None:
        topic = item.topic
        try:
            message = decode(topic, item.encoding, item.payload)
            if message.owner != item.owner:
                raise ForeignMessage(topic.name, item.owner, message.owner)
            return message
        except ContractError as error:
            self._tally.rejected[topic.name] += 1
            if (topic.name, error.code) not in self._complained:
                self._complained.add((topic.name, error.code))
                extra = {"key": item.key, **error.describe(), **self._episodes.about(item.owner)}
                log.warning("message rejected", extra=extra)
            return None

    def _is_current(self, message: Message) -> bool:
        """Fence epochs: a new configuration opens one, everything else must belong to it."""
        cell, epoch = message.header.cell, message.header.epoch
        current = self._epochs.get(cell, 0)
        if type(message) is EpisodeConfigure:
            if epoch < current:
                return False
            self._enter_epoch(message)
            return True
        return epoch == current

    def _enter_epoch(self, configure: EpisodeConfigure) -> None:
        self._epochs[configure.header.cell] = configure.header.epoch
        self._modes[configure.header.cell] = configure.mode
        self._episodes.begin(configure)

    def _count_gap(self, topic: str, header: Header) -> None:
        key = (header.source, topic, header.cell)
        last = self._last_seen.get(key)
        if last is not None and header.seq > last + 1:
            self._tally.missing[topic] += header.seq - last - 1
        self._last_seen[key] = header.seq

    def _handle(self, messages: Sequence[AnyMessage]) -> None:
        started = time.perf_counter_ns()
        self._tally.handled += len(messages)
        # A list, so that publishing is not counted as the reactor's time.
        outputs = list(self.reactor.handle(messages))
        took_ns = time.perf_counter_ns() - started
        self._tally.handle_ns += took_ns
        if self._exporter is not None:
            self._exporter.handled(messages, outputs, took_ns=took_ns)
        for message in messages:
            # Asked of every message: `isinstance` of a pydantic model takes half a microsecond.
            if type(message) is EpisodeConfigure:
                self._follow(message.header.cell)
                self._episodes.prepare(message, takes_part=self.reactor.serves(message.header.cell))
            elif type(message) is EpisodeAbort:
                self._episodes.abort(message)
        for message in outputs:
            if isinstance(message, AskDescription):
                self.ask_description(message.node)
            elif not isinstance(message, LocalMessage):
                self._publish(message)
            elif self._sink is not None:
                self._sink(message)

    def _publish(self, message: Message) -> None:
        if type(message) is EpisodeConfigure:
            self._enter_epoch(message)
        header = message.header
        sequence_key = (type(message).__name__, header.cell)
        seq = self._sequence[sequence_key] = self._sequence[sequence_key] + 1
        stamped = message.stamped(source=self.node, seq=seq, t_mono_ns=time.monotonic_ns())
        topic = topic_of(type(message))
        self._tally.published[topic.name] += 1
        if topic.is_control:
            self._episodes.send(message)
        self._bus.publish(
            stamped,
            owner=header.cell or self.node,
            mode=self._modes.get(header.cell, "lockstep"),
        )
