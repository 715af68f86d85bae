"""Which nodes are there, what they offer, and who is missing."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from common.api import ServiceInfo
from common.bus.grants import includes
from common.messages import (
    ONLY_CELLS,
    CheckpointDescription,
    NodeDescription,
    NodeMetrics,
    PolicyLoad,
    PolicyLoaded,
)

ROUTER_KIND = "router"
NODE_KINDS = ("sim", "retarget", "gripper", "policy")
"""Kinds of node that take part in an episode."""

_ASK_AGAIN_NS = 1_000_000_000
_KEPT_LOST_NODES = 64
_POLICY_KIND = "policy"


@dataclass
class Node:
    """What is known of one node; it stays known after it was lost."""

    kind: str
    node: str
    alive: bool = True
    description: NodeDescription | None = None
    metrics: NodeMetrics | None = None
    asked_ns: int | None = None
    loading: set[str] = field(default_factory=set[str])
    """Requests to load a checkpoint that it has not answered: what it offers may change."""

    @property
    def ready(self) -> bool:
        """Alive, and what it offers is known and stays."""
        return self.alive and self.description is not None and not self.loading

    def offers(self, what: str, name: str) -> bool:
        """Whether it offers, or offered before it was lost, e.g. the robot `panda`."""
        return self.description is not None and name in self.description.offers.get(what, [])

    def may_serve(self, cell: str) -> bool:
        """Whether it has rights in a cell, by its own words; access control goes by others."""
        offers = {} if self.description is None else self.description.offers
        return includes(offers.get(ONLY_CELLS, ["*"]), cell)

    def info(self) -> ServiceInfo:
        """The node as REST shows it."""
        described, metrics = self.description, self.metrics
        counters = {} if metrics is None else metrics.model_dump(exclude={"header", "node"})
        return ServiceInfo(
            kind=self.kind,
            node=self.node,
            alive=self.alive,
            code_version=None if described is None else described.code_version,
            packages={} if described is None else described.packages,
            host=None if described is None else described.host,
            pid=None if described is None else described.pid,
            offers={} if described is None else described.offers,
            checkpoints={} if described is None else described.checkpoints,
            metrics=counters,
        )


@dataclass(frozen=True)
class Need:
    """A node that an episode needs: its kind and, for some kinds, what it must offer."""

    kind: str
    offer: tuple[str, str] | None = None

    def is_met_by(self, node: Node) -> bool:
        """Whether a node is, or was, of this sort."""
        return node.kind == self.kind and (self.offer is None or node.offers(*self.offer))

    def __str__(self) -> str:
        return self.kind if self.offer is None else f"{self.kind} for {self.offer[1]}"


class NodeRegistry:
    """The nodes by kind and name."""

    def __init__(self) -> None:
        self._nodes: dict[tuple[str, str], Node] = {}

    def add(self, kind: str, node: str) -> None:
        """A node is there; what an earlier one of its name said counts no more."""
        self._nodes.pop((kind, node), None)
        self._nodes[kind, node] = Node(kind, node)

    def lose(self, kind: str, node: str) -> set[str]:
        """A node is gone. It stays known, so that a message can name it.

        Returns:
            Requests to load a checkpoint that it will not answer.
        """
        unanswered = set[str]()
        lost = self._nodes.pop((kind, node), None)
        if lost is not None:
            unanswered, lost.loading = lost.loading, unanswered
            lost.alive = False
            self._nodes[kind, node] = lost
        gone = [key for key, known in self._nodes.items() if not known.alive]
        for key in gone[:-_KEPT_LOST_NODES]:
            del self._nodes[key]
        return unanswered

    def begin_load(self, load: PolicyLoad) -> bool:
        """A policy service is told to load a checkpoint; False if there is no such service."""
        node = self._nodes.get((_POLICY_KIND, load.node))
        if node is None or not node.ready:
            return False
        node.loading.add(load.request)
        return True

    def end_load(self, loaded: PolicyLoaded) -> None:
        """It has answered, and offers what it loaded."""
        node = self._nodes.get((_POLICY_KIND, loaded.node))
        if node is None or loaded.request not in node.loading:
            return
        node.loading.remove(loaded.request)
        said, checkpoint = node.description, loaded.checkpoint
        if said is not None and checkpoint is not None:
            policies = {*said.offers.get("policies", []), loaded.policy}
            node.description = said.model_copy(
                update={
                    "offers": {**said.offers, "policies": sorted(policies)},
                    "checkpoints": {**said.checkpoints, loaded.policy: checkpoint},
                }
            )

    def describe(self, description: NodeDescription) -> None:
        """Take a node's answer."""
        node = self._nodes.get((description.kind, description.node))
        if node is not None and node.alive:
            node.description = description

    def checkpoints(self, node: str) -> dict[str, CheckpointDescription] | None:
        """What a policy service has in memory; None while it is not ready."""
        known = self._nodes.get((_POLICY_KIND, node))
        if known is None or not known.ready or known.description is None:
            return None
        return known.description.checkpoints

    def measure(self, metrics: NodeMetrics) -> None:
        """Take a node's counters."""
        for node in self._nodes.values():
            if node.node == metrics.node and node.alive:
                node.metrics = metrics

    def find_restarted(self, metrics: NodeMetrics) -> tuple[str, str] | None:
        """Kind and name of a node whose count of beats has started over, though it never left.

        A token that is declared again within the lease of the one before never goes, for anybody:
        the process behind it is another one, which knows nothing of its episodes.
        """
        named = [node for node in self._nodes.values() if node.node == metrics.node and node.alive]
        for node in named:
            before = node.metrics
            # Two nodes of one name have one key for their beats: nothing can be told from it.
            if before is not None and metrics.header.seq < before.header.seq and len(named) == 1:
                return node.kind, node.node
        return None

    def undescribed(self, now_ns: int) -> list[str]:
        """Nodes to ask what they are: not asked yet, or without an answer for a second."""
        due: list[str] = []
        for node in self._nodes.values():
            waited = node.asked_ns is None or now_ns - node.asked_ns >= _ASK_AGAIN_NS
            if node.alive and node.description is None and waited:
                node.asked_ns = now_ns
                due.append(node.node)
        return due

    def ready(self, need: Need) -> list[Node]:
        """Nodes that meet a need now, by name."""
        found = [node for node in self._nodes.values() if node.ready and need.is_met_by(node)]
        return sorted(found, key=lambda node: node.node)

    def choose(
        self, needs: tuple[Need, ...], load: Counter[str], *, cell: str
    ) -> dict[str, str] | None:
        """For each need the least loaded node that meets it in a cell, by name among equals.

        Returns:
            Kind -> node, without the cell's own; None if there is none for some need.
        """
        chosen: dict[str, str] = {}
        for need in needs:
            if need.kind != "sim":
                found = [node for node in self.ready(need) if node.may_serve(cell)]
                if not found:
                    return None
                chosen[need.kind] = min(found, key=lambda node: load[node.node]).node
        return chosen

    def missing(self, needs: tuple[Need, ...]) -> tuple[str, ...]:
        """Who is missing: the node that left last, else what kind of node it should be.

        If nobody is, but no cell is there in which all of them have rights, that.
        """
        names: list[str] = []
        for need in needs:
            if not self.ready(need):
                left = [n.node for n in self._nodes.values() if not n.alive and need.is_met_by(n)]
                names.append(f"{need.kind} {left[-1]}" if left else str(need))
        cells = [sim.node for sim in self.ready(Need("sim"))]
        if not names and all(self.choose(needs, Counter(), cell=cell) is None for cell in cells):
            wanted = ", ".join(str(need) for need in needs if need.kind != "sim")
            names.append(f"a cell in which {wanted} have rights")
        return tuple(names)

    def versions(self, nodes: dict[str, str], *, policy: str) -> dict[str, str]:
        """Code and packages of the nodes of an episode; differing ones are all named.

        Args:
            nodes: Kind -> node.
            policy: Who acts; of a learned one, the hash is a version too.
        """
        found: dict[str, set[str]] = {}
        for key in nodes.items():
            description = self._nodes[key].description
            if description is not None:
                said = {"legato": description.code_version, **description.packages}
                if policy in description.checkpoints:
                    said[f"policy {policy}"] = description.checkpoints[policy].sha256
                for name, version in said.items():
                    found.setdefault(name, set()).add(version)
        return {name: ", ".join(sorted(versions)) for name, versions in sorted(found.items())}

    def cells(self) -> dict[str, bool]:
        """Every known cell, which is named as its owner, and whether the owner is there."""
        return {node.node: node.alive for node in self._nodes.values() if node.kind == "sim"}

    def infos(self) -> tuple[ServiceInfo, ...]:
        """Every known node, by kind and name."""
        return tuple(self._nodes[key].info() for key in sorted(self._nodes))
