"""Orders to load checkpoints on their way through the scheduler."""

from __future__ import annotations

from collections.abc import Iterator

from common.errors import NotReady
from common.messages import Header, LocalMessage, Message, PolicyLoad, PolicyLoaded, Problem
from services.control.events import LoadPolicy, NodesChanged, PolicyLoadEnded
from services.control.nodes import NodeRegistry
from services.control.reloads import Reloads


class PolicyLoading:
    """Passes orders on to policy services, and their answers to whoever asked.

    A service that has started again is told again what it had loaded. Every method gives what is
    to be sent.

    Args:
        registry: The nodes; trials for a service that loads wait until it has answered.
    """

    def __init__(self, registry: NodeRegistry) -> None:
        self._registry = registry
        self._reloads = Reloads()

    def order(self, order: LoadPolicy) -> Iterator[Message | LocalMessage]:
        """Pass an order on, or refuse it at once."""
        load = PolicyLoad(
            header=Header(),
            request=order.request,
            node=order.node,
            policy=order.policy,
            folder=order.folder,
        )
        if self._registry.begin_load(load):
            self._reloads.begin(load)
            yield load
        else:
            yield self._refuse(order.request, order.node)

    def take_answer(self, message: PolicyLoaded) -> Iterator[Message | LocalMessage]:
        """A service has loaded a checkpoint or could not."""
        self._registry.end_load(message)
        self._reloads.end(message)
        yield from self.load_again(message.node)
        # First what is there now, then the word that it is.
        yield NodesChanged(self._registry.infos())
        yield PolicyLoadEnded(message.request, message.problem)

    def load_again(self, node: str) -> Iterator[Message]:
        """Tell a service that has started again the next of what it was told before."""
        serves = self._registry.checkpoints(node)
        load = None if serves is None else self._reloads.take(node, serves)
        if load is not None and self._registry.begin_load(load):
            self._reloads.begin(load)
            yield load

    def restart(self, node: str) -> None:
        """A service has started."""
        self._reloads.restart(node)

    def lose(self, requests: set[str], node: str) -> Iterator[LocalMessage]:
        """A service is gone and will not answer these."""
        self._reloads.lose(requests)
        for request in requests:
            yield self._refuse(request, node)

    def _refuse(self, request: str, node: str) -> PolicyLoadEnded:
        running = [info.node for info in self._registry.infos() if info.alive]
        error = NotReady(f"the policy service {node}", running)
        return PolicyLoadEnded(request, Problem(**error.describe()))
