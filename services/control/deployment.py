"""What runs now, as the edges see it: the scheduler's last word, safe to read on any thread."""

from __future__ import annotations

from collections.abc import Sequence

from common.api import PolicyInfo, ServiceInfo
from common.messages import CheckpointDescription
from services.control.cells import CellStates
from services.control.loads import LoadWaiters


class Deployment:
    """Nodes and what evaluations wait for. One thread writes whole values, others read them."""

    def __init__(self) -> None:
        self.nodes: tuple[ServiceInfo, ...] = ()
        self.waiting: dict[str, tuple[str, ...]] = {}
        self.loads = LoadWaiters()
        self.cells = CellStates()

    def set_waiting(self, evaluation: str, names: Sequence[str]) -> None:
        """Note what an evaluation waits for; nothing ends the note."""
        others = {key: value for key, value in self.waiting.items() if key != evaluation}
        self.waiting = others | ({evaluation: tuple(names)} if names else {})

    def ready(self, kind: str) -> list[ServiceInfo]:
        """Nodes of a kind that are alive and have said what they are."""
        return [
            node
            for node in self.nodes
            if node.kind == kind and node.alive and node.code_version is not None
        ]

    @property
    def running(self) -> list[str]:
        """Every node that is alive, as `kind name`."""
        return [f"{node.kind} {node.node}" for node in self.nodes if node.alive]

    def robots(self) -> set[str]:
        """Robots for which a retargeter runs."""
        return {name for node in self.ready("retarget") for name in node.offers.get("robots", [])}

    def policies(self) -> list[PolicyInfo]:
        """Policies that running nodes offer, by name."""
        nodes: dict[str, list[str]] = {}
        checkpoints: dict[str, dict[str, CheckpointDescription]] = {}
        for node in self.ready("policy"):
            for name in node.offers.get("policies", []):
                nodes.setdefault(name, []).append(node.node)
            for name, checkpoint in node.checkpoints.items():
                checkpoints.setdefault(name, {})[node.node] = checkpoint
        return [
            PolicyInfo(name=name, nodes=nodes[name], checkpoints=checkpoints.get(name, {}))
            for name in sorted(nodes)
        ]

    def missing(self) -> list[str]:
        """Kinds without which nothing can be evaluated and that have no ready node."""
        return [kind for kind in ("sim", "gripper", "policy", "retarget") if not self.ready(kind)]
