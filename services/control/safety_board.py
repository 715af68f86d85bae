"""Which cells are to stand still, and what their guards say of themselves."""

from __future__ import annotations

from common.api import CellInfo
from common.messages import Header, SafetyReset, SafetyState, SafetyStop
from services.control.nodes import NodeRegistry

SENDER = "control"
_AGAIN_NS = 100_000_000


class SafetyBoard:
    """Repeats an order until the cell's owner says that it is carried out.

    A cell that was stopped stays so when its owner is lost and comes back: the stop is sent again.
    """

    def __init__(self) -> None:
        self._states: dict[str, SafetyState] = {}
        self._orders: dict[str, SafetyStop | SafetyReset] = {}
        self._sent_ns: dict[str, int] = {}
        self._stopped = set[str]()

    def order(self, order: SafetyStop | SafetyReset) -> None:
        """Stop a cell, or release it; the last order counts."""
        cell = order.header.cell
        self._orders[cell] = order
        self._sent_ns.pop(cell, None)

    def take_due(self, now_ns: int) -> list[SafetyStop | SafetyReset]:
        """Orders to be sent now."""
        due: list[SafetyStop | SafetyReset] = []
        for cell, order in self._orders.items():
            sent_ns = self._sent_ns.get(cell)
            if sent_ns is None or now_ns - sent_ns >= _AGAIN_NS:
                self._sent_ns[cell] = now_ns
                due.append(order)
        return due

    def hear(self, state: SafetyState) -> None:
        """Take what a guard says."""
        cell = state.header.cell
        self._states[cell] = state
        order = self._orders.get(cell)
        if isinstance(order, SafetyStop) and not state.emergency_stop:
            return
        if isinstance(order, SafetyReset) and state.fault is not None:
            return
        self._orders.pop(cell, None)
        if state.emergency_stop:
            self._stopped.add(cell)
        else:
            self._stopped.discard(cell)

    def lose(self, cell: str) -> None:
        """The owner of a cell is gone. One that starts again knows of no stop."""
        self._states.pop(cell, None)
        if cell in self._stopped and cell not in self._orders:
            self.order(
                SafetyStop(header=Header(cell=cell), by=SENDER, reason="stopped before it was lost")
            )

    def is_stopped(self, cell: str) -> bool:
        """Whether no episode may begin there."""
        return cell in self._stopped or cell in self._orders

    def infos(self, registry: NodeRegistry) -> tuple[CellInfo, ...]:
        """Every known cell, by name."""
        return tuple(self._info(cell, alive) for cell, alive in sorted(registry.cells().items()))

    def _info(self, cell: str, alive: bool) -> CellInfo:
        state = self._states.get(cell)
        if state is None:
            return CellInfo(
                cell=cell, alive=alive, status=None, fault=None, emergency_stop=False, counts=None
            )
        return CellInfo(
            cell=cell,
            alive=alive,
            status=state.status,
            fault=state.fault,
            emergency_stop=state.emergency_stop,
            counts=state.counts,
        )
