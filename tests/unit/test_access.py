"""The router's rules, as data."""

from __future__ import annotations

import pytest
import zenoh

from common import messages as m
from common.bus.access import ROLES, check_node_name, make_access_control, role_named
from common.errors import InvalidValue, UnknownName
from common.topics import key_of, topic_of


def granted(role: str, flow: str, message: str) -> set[str]:
    """Keys of namespace `ns` for which a role has a right."""
    config = make_access_control("ns")
    (policy,) = (each for each in config["policies"] if each["subjects"] == [role])
    return {
        key
        for rule in config["rules"]
        if rule["id"] in policy["rules"] and flow in rule["flows"] and message in rule["messages"]
        for key in rule["key_exprs"]
    }


def allows(keys: set[str], key: str) -> bool:
    return any(zenoh.KeyExpr(each).includes(zenoh.KeyExpr(key)) for each in keys)


def test_what_is_not_allowed_is_denied():
    config = make_access_control("ns")
    assert config["enabled"] is True
    assert config["default_permission"] == "deny"
    assert {rule["permission"] for rule in config["rules"]} == {"allow"}
    assert all(key.startswith("ns/") for rule in config["rules"] for key in rule["key_exprs"])
    assert len({rule["id"] for rule in config["rules"]}) == len(config["rules"])
    names = [each["cert_common_names"] for each in config["subjects"]]
    assert names == [[role.name] for role in ROLES]


@pytest.mark.parametrize("role", ROLES, ids=lambda role: role.name)
@pytest.mark.parametrize(
    "message", role_named("viewer").reads, ids=lambda message: message.__name__
)
def test_rights_are_those_of_the_table(role, message):
    topic = topic_of(message)
    owner = "cell-1" if topic.scope == "cell" else f"{role.kind}-1"
    key = f"ns/{key_of(topic, owner)}"
    assert allows(granted(role.name, "ingress", "put"), key) == (message in role.writes)
    for flow, kind in (("egress", "put"), ("ingress", "declare_subscriber")):
        assert allows(granted(role.name, flow, kind), key) == (message in role.reads)


def test_a_policy_host_reads_cameras_and_writes_actions_and_nothing_else():
    assert granted("policy", "egress", "put") == {
        "ns/cell/*/episode/abort",
        "ns/cell/*/episode/configure",
        "ns/cell/*/camera/stereo",
        "ns/policy/load/*",
    }
    assert granted("policy", "ingress", "put") == {
        "ns/cell/*/episode/ready",
        "ns/cell/*/policy/action",
        "ns/policy/loaded/policy$*",
        "ns/metrics/policy$*",
    }


def test_only_the_expert_sees_the_truth():
    key = f"ns/{key_of(topic_of(m.GroundTruth), 'c')}"
    roles = {role.name for role in ROLES if allows(granted(role.name, "egress", "put"), key)}
    assert roles == {"expert", "viewer"}


def test_a_node_speaks_for_itself_only():
    own = granted("policy", "ingress", "put")
    assert allows(own, "ns/metrics/policy-remote")
    assert not allows(own, "ns/metrics/sim-0")
    tokens = granted("policy", "ingress", "liveliness_token")
    assert allows(tokens, "ns/alive/policy/policy")
    assert not allows(tokens, "ns/alive/sim/sim-0")
    assert not allows(tokens, "ns/alive/policy/sim-0")
    answers = granted("policy", "ingress", "reply")
    assert allows(answers, "ns/rpc/policy/describe")
    assert not allows(answers, "ns/rpc/sim-0/describe")


def test_a_viewer_says_nothing():
    for message in ("put", "liveliness_token", "declare_queryable", "query", "reply", "delete"):
        assert granted("viewer", "ingress", message) == set()


def test_a_node_that_would_not_be_heard_is_refused():
    check_node_name("policy", "policy-remote")
    with pytest.raises(InvalidValue, match='begins with "policy"'):
        check_node_name("policy", "gpu-host")
    with pytest.raises(UnknownName, match="no role"):
        role_named("polcy")
