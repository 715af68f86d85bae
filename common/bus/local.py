"""A bus whose nodes all live in one process and one thread."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import zenoh

from common.bus.bus import Bus, Subscription
from common.bus.inbox import Handed, Inbox
from common.messages import Message, Mode
from common.topics import Topic, key_of, topic_of


@dataclass(frozen=True)
class _Listener:
    """Who hears a topic: of one cell or node, or of all (`*`)."""

    topic: Topic
    owner: str
    inbox: Inbox


@dataclass(frozen=True)
class _Route:
    """Who hears a topic of one cell or node, until somebody begins or ends to listen."""

    key: str
    inboxes: tuple[Inbox, ...]


class LocalBus(Bus):
    """Hands messages over as they are; liveliness and descriptions still go through Zenoh.

    Messages are frozen and checked when they are made, so nothing is lost by not packing them.
    Packing, Zenoh's delivery, unpacking and checking again cost 0.1 ms per message, and four of
    them travel per tick of 10 ms: without them an evaluation in one process runs twice as fast.
    Order, depth of the inboxes and counting are those of the other bus.
    """

    def __init__(self, session: zenoh.Session) -> None:
        super().__init__(session)
        self._listeners: defaultdict[str, list[_Listener]] = defaultdict(list)
        self._routes: dict[tuple[str, str], _Route] = {}

    def publish(self, message: Message, *, owner: str, mode: Mode) -> None:
        """Put a message into the inbox of everybody who hears its topic.

        Args:
            message: Any message with a topic.
            owner: Cell or node whose key it goes to.
            mode: Of no importance here: nothing is lost in either.
        """
        del mode
        topic = topic_of(type(message))
        route = self._routes.get((topic.name, owner)) or self._find_route(topic, owner)
        if route.inboxes:
            handed = Handed(topic, route.key, owner, message)
            for inbox in route.inboxes:
                inbox.put(handed)

    def subscribe(self, topic: Topic, inbox: Inbox, *, owner: str = "*") -> Subscription:
        """Let every message of a topic, of one cell or of all, fall into an inbox."""
        inbox.open_topic(topic)
        listener = _Listener(topic, owner, inbox)
        self._listeners[topic.name].append(listener)
        self._routes.clear()
        return Subscription(listener)

    def unsubscribe(self, subscription: Subscription) -> None:
        """End a subscription; what already waits in the inbox stays there."""
        listener: _Listener = subscription.declared
        self._listeners[listener.topic.name] = [
            each for each in self._listeners[listener.topic.name] if each is not listener
        ]
        self._routes.clear()

    def _find_route(self, topic: Topic, owner: str) -> _Route:
        route = self._routes[topic.name, owner] = _Route(
            key_of(topic, owner),
            tuple(
                listener.inbox
                for listener in self._listeners[topic.name]
                if listener.owner in ("*", owner)
            ),
        )
        return route
