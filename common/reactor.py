"""What a service is: an object that is given typed messages and returns typed messages."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from typing import ClassVar, TypeAlias

from common.messages import CheckpointDescription, LocalMessage, Message
from common.metrics.metric import Sample

AnyMessage: TypeAlias = Message | LocalMessage


class Reactor(ABC):
    """A service: it is given typed messages and returns typed messages.

    It owns no thread, no socket, no clock and no bus. Time reaches it as `Tick`, other nodes as
    `NodeUp` and `NodeDown`. Subclasses set `kind` and `inputs` and implement `handle`.
    """

    kind: ClassVar[str]
    inputs: ClassVar[tuple[type[Message], ...]]
    watches_nodes: ClassVar[bool] = False
    """Whether it is told about `NodeUp` and `NodeDown`, and given each node's description."""
    packages: ClassVar[tuple[str, ...]] = ()
    """Third-party packages that shape its results, for the record."""

    @abstractmethod
    def handle(self, messages: Sequence[AnyMessage]) -> Iterable[AnyMessage]:
        """Take what is waiting and return what to send, in order."""

    def offers(self) -> Mapping[str, list[str]]:
        """What this node can serve, e.g. `{"robots": ["panda"]}`."""
        return {}

    def checkpoints(self) -> Mapping[str, CheckpointDescription]:
        """Learned policies that it has in memory, by name."""
        return {}

    def measure(
        self, given: Sequence[AnyMessage], returned: Sequence[AnyMessage], began_ns: int
    ) -> Iterable[Sample]:
        """Samples for histograms of one call of `handle`. Asked only where metrics are exported.

        Args:
            given: What `handle` was given.
            returned: What it returned.
            began_ns: This process's monotonic clock when it was called.
        """
        del given, returned, began_ns
        return ()

    def levels(self) -> Iterable[Sample]:
        """Totals and current values. Asked once a second, only where metrics are exported."""
        return ()

    def serves(self, cell: str) -> bool:
        """Whether data of this cell concerns it now; what does not is dropped undecoded."""
        del cell
        return True

    @property
    def owned_cell(self) -> str | None:
        """The one cell it owns, or None to hear all cells."""
        return None

    @property
    def tick_period_s(self) -> float:
        """How often it wants a `Tick`."""
        return 0.1
