"""Who may say and hear what on the bus: the roles, and the router's rules made of them.

A certificate's common name is its role, or a name that has a role in some cells only
(`common/bus/grants.py`). Everything that no rule allows is
dropped by the router, silently: what a role needs has to stand here, and `tests/contract` compares
it with the services.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from common import messages as m
from common.errors import InvalidValue, UnknownName
from common.topics import TOPICS, Topic, key_of, topics_of

if TYPE_CHECKING:
    from common.bus.grants import Grant

Flow = Literal["ingress", "egress"]
"""Seen from the router: what comes from a process, what goes to it."""


@dataclass(frozen=True)
class Role:
    """What the processes with one kind of certificate may do.

    Args:
        name: Common name of the certificate.
        kind: Kind of the node that it may be; None: it only listens. Names of its nodes begin with
            it, so that no node can speak for one of another kind.
        reads: Messages that it may receive.
        writes: Messages that it may send.
        watches: Whether it may see which nodes are alive and ask them what they are.
        per_cell: Whether a certificate may have these rights in some cells only.
    """

    name: str
    kind: str | None
    reads: tuple[type[m.Message], ...] = ()
    writes: tuple[type[m.Message], ...] = ()
    watches: bool = False
    per_cell: bool = True


_POLICY_READS = (m.EpisodeConfigure, m.EpisodeAbort, m.PolicyLoad, m.StereoFrame)
_POLICY_WRITES = (m.EpisodeReady, m.PolicyAction, m.PolicyLoaded, m.NodeMetrics)

ROLES: tuple[Role, ...] = (
    Role("router", "router", writes=(m.NodeMetrics,), per_cell=False),
    Role(
        "control",
        "control",
        reads=(
            m.EpisodeReady,
            m.EpisodeResult,
            m.EpisodePicture,
            m.SafetyState,
            m.PolicyLoaded,
            m.NodeDescription,
            m.NodeMetrics,
        ),
        writes=(
            m.EpisodeConfigure,
            m.EpisodeStart,
            m.EpisodeAbort,
            m.SafetyStop,
            m.SafetyReset,
            m.PolicyLoad,
            m.NodeMetrics,
        ),
        watches=True,
        per_cell=False,
    ),
    Role(
        "sim",
        "sim",
        reads=(
            m.EpisodeConfigure,
            m.EpisodeStart,
            m.EpisodeAbort,
            m.SafetyStop,
            m.SafetyReset,
            m.PolicyAction,
            m.RobotCommand,
            m.RetargetStatus,
            m.MotorCommand,
        ),
        writes=(
            m.EpisodeReady,
            m.EpisodePicture,
            m.EpisodeResult,
            m.SafetyState,
            m.RobotState,
            m.MotorState,
            m.StereoFrame,
            m.GroundTruth,
            m.NodeMetrics,
        ),
    ),
    Role(
        "retarget",
        "retarget",
        reads=(m.EpisodeConfigure, m.EpisodeAbort, m.RobotState, m.PolicyAction),
        writes=(m.EpisodeReady, m.RobotCommand, m.RetargetStatus, m.NodeMetrics),
    ),
    Role(
        "gripper",
        "gripper",
        reads=(m.EpisodeConfigure, m.EpisodeAbort, m.MotorState, m.PolicyAction),
        writes=(m.EpisodeReady, m.MotorCommand, m.GripperState, m.NodeMetrics),
    ),
    Role("policy", "policy", reads=_POLICY_READS, writes=_POLICY_WRITES),
    # The scripted expert acts on what a learned policy must not know.
    Role("expert", "policy", reads=(*_POLICY_READS, m.GroundTruth), writes=_POLICY_WRITES),
    Role("viewer", None, reads=tuple(topic.message for topic in TOPICS)),
)


def role_named(name: str) -> Role:
    """Look a role up.

    Raises:
        UnknownName: There is none of that name.
    """
    for role in ROLES:
        if role.name == name:
            return role
    raise UnknownName("role", name, [role.name for role in ROLES])


def kind_that_writes(message: type[m.Message]) -> str:
    """The one kind of node that sends messages of a type.

    Raises:
        InvalidValue: None does, or several do.
    """
    kinds = {role.kind for role in ROLES if role.kind is not None and message in role.writes}
    if len(kinds) != 1:
        sent = ", ".join(sorted(kinds)) or "nobody"
        raise InvalidValue("message", message.__name__, f"one that one kind sends, not {sent}")
    return kinds.pop()


def check_node_name(kind: str, node: str) -> None:
    """Refuse a name under which the router would drop everything that the node says of itself.

    Raises:
        InvalidValue: It does not begin with the kind of the node.
    """
    if not node.startswith(kind):
        raise InvalidValue(
            "--node", node, f'a name that begins with "{kind}", by which access control goes'
        )


def make_access_control(namespace: str, grants: Iterable[Grant] = ()) -> dict[str, Any]:
    """Zenoh's configuration `access_control` for the keys of one namespace; all others are denied.

    Args:
        namespace: Prefix of the keys.
        grants: Rights in some cells only, beside those of the roles. Revoked ones give none.

    Source: Zenoh 1.10, DEFAULT_CONFIG.json5, section access_control.
    """
    holders = [(role.name, role, ("*",)) for role in ROLES]
    holders += [
        (grant.name, role_named(grant.role), grant.cells)
        for grant in grants
        if grant.revoked is None
    ]
    rules: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    for name, role, cells in holders:
        own = [
            {
                "id": f"{name}-{number}",
                "permission": "allow",
                "flows": [flow],
                "messages": list(messages),
                "key_exprs": [f"{namespace}/{key}" for key in keys],
            }
            for number, (flow, messages, keys) in enumerate(_rights(role, cells))
        ]
        rules += own
        policies.append({"rules": [rule["id"] for rule in own], "subjects": [name]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": name, "cert_common_names": [name]} for name, _, _ in holders],
        "policies": policies,
    }


def _rights(
    role: Role, cells: Sequence[str]
) -> Iterable[tuple[Flow, Sequence[str], Sequence[str]]]:
    """Flow, kinds of Zenoh messages and keys of everything that a role may do in these cells."""
    # Zenoh's word for the rest of a name.
    owners = [cell if cell == "*" else cell.replace("*", "$*") for cell in cells]
    if role.reads:
        heard = topics_of(role.reads)
        # Episodes are waited for in all cells by one subscription; what it is told is decided here.
        yield "ingress", ("declare_subscriber",), [key_of(topic, "*") for topic in heard]
        yield "egress", ("put",), _keys(heard, owners=owners, nodes="*")
    if role.kind is not None:
        own = f"{role.kind}$*"
        yield "ingress", ("put",), _keys(topics_of(role.writes), owners=owners, nodes=own)
        yield "ingress", ("liveliness_token",), [f"alive/{role.kind}/{own}"]
        yield "ingress", ("declare_queryable", "reply"), [f"rpc/{own}/describe"]
        yield "egress", ("query",), [f"rpc/{own}/describe"]
    if role.watches:
        yield "ingress", ("declare_liveliness_subscriber", "liveliness_query"), ["alive/*/*"]
        yield "egress", ("liveliness_token",), ["alive/*/*"]
        yield "ingress", ("query",), ["rpc/*/describe"]
        yield "egress", ("reply",), ["rpc/*/describe"]


def _keys(topics: Iterable[Topic], *, owners: Sequence[str], nodes: str) -> list[str]:
    return [
        key_of(topic, owner)
        for topic in topics
        for owner in (owners if topic.scope == "cell" else (nodes,))
    ]
