"""The table of roles says what the services do: all of it and nothing else."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from pathlib import Path

import pytest

from common import messages as m
from common.bus.access import ROLES, Role, role_named
from common.reactor import Reactor
from common.topics import TOPICS, topics_of
from services.control.scheduler import Scheduler
from services.gripper.reactor import GripperReactor
from services.policy.reactor import PolicyReactor
from services.retarget.reactor import RetargetReactor
from services.router.presence import Presence
from services.sim.reactor import SimReactor

ROOT = Path(__file__).parents[2]

REACTORS: dict[str, type[Reactor]] = {
    "router": Presence,
    "control": Scheduler,
    "sim": SimReactor,
    "retarget": RetargetReactor,
    "gripper": GripperReactor,
    "expert": PolicyReactor,
}
NODES = [role for role in ROLES if role.name in REACTORS]
BY_NAME = {topic.message.__name__: topic.message for topic in TOPICS}


def find_made(package: Path) -> set[type[m.Message]]:
    """Messages with a topic that the code of a package makes."""
    return {
        BY_NAME[node.func.id]
        for file in package.rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id in BY_NAME
    }


@pytest.mark.parametrize("role", NODES, ids=lambda role: role.name)
def test_roles_are_the_services(role: Role):
    reactor = REACTORS[role.name]
    assert role.kind == reactor.kind
    assert role.watches == reactor.watches_nodes
    assert set(role.reads) == set(reactor.inputs)
    # Every host says how it is.
    assert set(role.writes) == find_made(ROOT / "services" / reactor.kind) | {m.NodeMetrics}


def test_every_process_has_a_role():
    processes = {path.parent.name for path in (ROOT / "services").glob("*/__main__.py")}
    assert processes == {role.kind for role in ROLES if role.kind is not None}
    assert {role.name for role in ROLES} == {*REACTORS, "policy", "viewer"}


def test_a_policy_is_an_expert_without_the_truth():
    policy, expert = role_named("policy"), role_named("expert")
    assert set(expert.reads) - set(policy.reads) == {m.GroundTruth}
    assert set(policy.writes) == set(expert.writes)
    assert (policy.kind, policy.watches) == (expert.kind, expert.watches)


def test_a_viewer_hears_everything_and_says_nothing():
    viewer = role_named("viewer")
    assert set(viewer.reads) == {topic.message for topic in TOPICS}
    assert (viewer.kind, viewer.writes, viewer.watches) == (None, (), False)


def test_only_control_loads_and_starts():
    for message in (m.EpisodeConfigure, m.EpisodeStart, m.EpisodeAbort, m.PolicyLoad):
        assert [role.name for role in ROLES if message in role.writes] == ["control"]


def format_topics(messages: Sequence[type[m.Message]]) -> str:
    """As docs/security.md writes them."""
    if len(messages) == len(TOPICS):
        return "everything"
    return ", ".join(f"`{topic.name}`" for topic in topics_of(messages)) or "nothing"


def test_the_documentation_has_this_table():
    rows = [
        f"| `{role.name}` | {format_topics(role.reads)} | {format_topics(role.writes)} |"
        for role in ROLES
    ]
    text = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")
    header = "| role | may hear | may say |\n|---|---|---|\n"
    assert text.partition(header)[2].partition("\n\n")[0].splitlines() == rows
