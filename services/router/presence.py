"""How the router shows itself to the nodes of a namespace."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from common.service import AnyMessage, Reactor


class Presence(Reactor):
    """Hears nothing and says nothing; its liveliness token `alive/router/<node>` is its purpose.

    The router's own session has no namespace, so a client session of the same process carries
    this. Both die together, and every other token vanishes with them: whoever names the cause of
    such a loss finds the router's token among the lost.
    """

    kind = "router"
    inputs = ()
    packages = ("eclipse-zenoh",)

    def handle(self, messages: Sequence[AnyMessage]) -> Iterable[AnyMessage]:
        """Do nothing."""
        del messages
        return ()
