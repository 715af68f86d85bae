"""The bus as the runner sees it: publish, subscribe, describe, liveliness."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self

import zenoh

from common.bus.codec import encode, encoding_of
from common.bus.inbox import Inbox, Received
from common.bus.threads import KeptThreads
from common.messages import Message, Mode, NodeDescription, NodeDown, NodeUp
from common.topics import Topic, key_of, topic_of

_PRIORITY = {
    "real_time": zenoh.Priority.REAL_TIME,
    "interactive_high": zenoh.Priority.INTERACTIVE_HIGH,
    "data": zenoh.Priority.DATA,
    "background": zenoh.Priority.BACKGROUND,
}

DESCRIBE_TIMEOUT_S = 2.0
_LOOKS, _LOOK_AGAIN_S = 4, 0.05
"""Zenoh 1.10 now and then answers a question for tokens with none, though there are some: rarely,
but half of the time in the first millisecond of a token. So nothing is asked for again."""


class DescribeRequest:
    """Another process asks what this node is. Answered on the worker thread."""

    def __init__(self, query: zenoh.Query) -> None:
        self._query = query

    def answer(self, description: NodeDescription) -> None:
        """Reply and release the query; one kept alive would block the asker until its time-out."""
        with self._query as query:
            query.reply(query.key_expr, encode(description), encoding=encoding_of(NodeDescription))


@dataclass(frozen=True)
class Subscription:
    """A subscription that can be ended before the bus is closed."""

    declared: Any


class Bus:
    """Typed access to one Zenoh session; closes what it declared.

    Callbacks are direct (`indirect=False`): no further thread, no hang at exit. They only put
    bytes into an `Inbox`.
    """

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._declared: list[Any] = []
        self._tokens: list[zenoh.LivelinessToken] = []
        self._keys: dict[tuple[str, str], Any] = {}
        self._encodings: dict[type[Message], zenoh.Encoding] = {}
        self._threads = KeptThreads()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    @property
    def is_closed(self) -> bool:
        """Whether the session is gone."""
        return self._session.is_closed()

    @property
    def is_linked(self) -> bool:
        """Whether there is a link to a router now."""
        return bool(self._session.info.routers_zid())

    def publish(self, message: Message, *, owner: str, mode: Mode) -> None:
        """Send a message on its topic.

        In lockstep nothing may be lost, so a full link is waited for (bounded by the session's
        `wait_before_close`); in real time only what the table calls lossless waits.

        Args:
            message: Any message with a topic.
            owner: Cell or node whose key it goes to.
            mode: Decides between waiting and dropping.
        """
        topic = topic_of(type(message))
        wait = topic.lossless or (mode == "lockstep" and topic.priority != "background")
        # Not a declared publisher: it would filter by subscribers it has not heard of yet and
        # lose the first message of a new cell.
        self._session.put(
            self._key(topic, owner),
            encode(message),
            encoding=self._encoding(type(message)),
            congestion_control=(
                zenoh.CongestionControl.BLOCK if wait else zenoh.CongestionControl.DROP
            ),
            priority=_PRIORITY[topic.priority],
            express=topic.priority != "background",
        )

    def subscribe(self, topic: Topic, inbox: Inbox, *, owner: str = "*") -> Subscription:
        """Let every message of a topic, of one cell or of all, fall into an inbox."""
        inbox.open_topic(topic)

        def store(sample: zenoh.Sample) -> None:
            self._threads.keep()
            if sample.kind == zenoh.SampleKind.PUT:
                inbox.put(
                    Received(
                        topic,
                        str(sample.key_expr),
                        str(sample.encoding),
                        sample.payload.to_bytes(),
                    )
                )

        declared = self._session.declare_subscriber(key_of(topic, owner), _direct(store))
        self._declared.append(declared)
        return Subscription(declared)

    def unsubscribe(self, subscription: Subscription) -> None:
        """End a subscription; what already waits in the inbox stays there."""
        self._declared.remove(subscription.declared)
        subscription.declared.undeclare()

    def serve_description(self, node: str, inbox: Inbox) -> None:
        """Let requests for this node's description fall into an inbox."""
        self._declared.append(
            self._session.declare_queryable(
                f"rpc/{node}/describe",
                _direct(lambda query: inbox.put_event(DescribeRequest(query))),
            )
        )

    def ask_description(self, node: str, inbox: Inbox) -> None:
        """Ask a node what it is; the answer falls into the inbox, silence leaves no trace."""
        topic = topic_of(NodeDescription)
        inbox.open_topic(topic)

        def store(reply: zenoh.Reply) -> None:
            sample = reply.ok
            if sample is not None:
                inbox.put(
                    Received(
                        topic,
                        key_of(topic, node),
                        str(sample.encoding),
                        sample.payload.to_bytes(),
                    )
                )

        self._session.get(f"rpc/{node}/describe", _direct(store), timeout=DESCRIBE_TIMEOUT_S)

    def declare_alive(self, kind: str, node: str) -> None:
        """Declare the liveliness token; the last thing a node does before it is ready."""
        token = self._session.liveliness().declare_token(f"alive/{kind}/{node}")
        self._tokens.append(token)

    def list_alive(self, kind: str = "*", *, timeout_s: float = 1.0) -> list[tuple[str, str]]:
        """Kind and node of every live token. Blocks: not for a worker thread."""
        found: list[tuple[str, str]] = []
        for attempt in range(_LOOKS):
            if attempt:
                time.sleep(_LOOK_AGAIN_S)
            replies = self._session.liveliness().get(f"alive/{kind}/*", timeout=timeout_s)
            keys = [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]
            found = sorted(_kind_and_node(key) for key in keys)
            if found:
                break
        return found

    def watch_alive(self, inbox: Inbox) -> None:
        """Let `NodeUp` and `NodeDown` of every node fall into an inbox, present ones first.

        A node that comes at this moment may be told twice.
        """

        def store(sample: zenoh.Sample) -> None:
            kind, node = _kind_and_node(str(sample.key_expr))
            up = sample.kind == zenoh.SampleKind.PUT
            inbox.put_event(NodeUp(kind, node) if up else NodeDown(kind, node))

        self._declared.append(
            self._session.liveliness().declare_subscriber("alive/*/*", _direct(store), history=True)
        )

    def close(self) -> None:
        """Undeclare everything, tokens first, so that others see the node leave at once."""
        for declared in (*self._tokens, *reversed(self._declared)):
            if not self._session.is_closed():
                declared.undeclare()
        self._tokens.clear()
        self._declared.clear()

    def _key(self, topic: Topic, owner: str) -> Any:
        key = self._keys.get((topic.name, owner))
        if key is None:
            # A declared key travels as a number.
            key = self._session.declare_keyexpr(key_of(topic, owner))
            self._keys[topic.name, owner] = key
        return key

    def _encoding(self, message: type[Message]) -> zenoh.Encoding:
        encoding = self._encodings.get(message)
        if encoding is None:
            encoding = self._encodings[message] = zenoh.Encoding(encoding_of(message))
        return encoding


def _direct(callback: Callable[[Any], None]) -> Any:
    return zenoh.handlers.Callback(callback, indirect=False)


def _kind_and_node(key: str) -> tuple[str, str]:
    _, kind, node = key.rsplit("/", 2)
    return kind, node
