"""Rights in some cells: the file, the patterns, and the rules that the router makes of them."""

from __future__ import annotations

import json
import stat
from datetime import UTC, datetime
from pathlib import Path

import pytest
import zenoh
from pydantic import TypeAdapter, ValidationError

from common.bus.access import ROLES, make_access_control
from common.bus.grants import (
    CellPattern,
    Grant,
    Grants,
    add_grant,
    check_cell,
    includes,
    now,
    read_grants,
    read_own,
    revoke_grant,
)
from common.errors import BadGrants, InvalidValue, UnknownName

WHEN = datetime(2026, 1, 2, tzinfo=UTC)
GIVEN = Grant(name="policy-gpu1", role="policy", cells=("sim-lab1", "sim-b*"), created=WHEN)
PER_CELL = [role for role in ROLES if role.per_cell]


def keys(holder: str, flow: str, message: str, *grants: Grant) -> set[str]:
    """Keys of namespace `ns` for which a name has a right."""
    config = make_access_control("ns", grants)
    (policy,) = (each for each in config["policies"] if each["subjects"] == [holder])
    return {
        key
        for rule in config["rules"]
        if rule["id"] in policy["rules"] and flow in rule["flows"] and message in rule["messages"]
        for key in rule["key_exprs"]
    }


@pytest.fixture
def router(tmp_path) -> Path:
    (tmp_path / "router").mkdir()
    return tmp_path / "router"


def add(router: Path, name: str = "policy-gpu1") -> Path:
    def issue() -> Path:
        (router.parent / name).mkdir()
        return router.parent / name

    return add_grant(router, GIVEN.model_copy(update={"name": name}), issue=issue)


def test_messages_of_its_cells_and_no_others():
    assert keys("policy-gpu1", "egress", "put", GIVEN) == {
        "ns/cell/sim-lab1/episode/abort",
        "ns/cell/sim-b$*/episode/abort",
        "ns/cell/sim-lab1/episode/configure",
        "ns/cell/sim-b$*/episode/configure",
        "ns/cell/sim-lab1/camera/stereo",
        "ns/cell/sim-b$*/camera/stereo",
        "ns/policy/load/*",
    }
    assert keys("policy-gpu1", "ingress", "put", GIVEN) == {
        "ns/cell/sim-lab1/episode/ready",
        "ns/cell/sim-b$*/episode/ready",
        "ns/cell/sim-lab1/policy/action",
        "ns/cell/sim-b$*/policy/action",
        "ns/policy/loaded/policy$*",
        "ns/metrics/policy$*",
    }


@pytest.mark.parametrize("role", PER_CELL, ids=lambda role: role.name)
def test_in_all_cells_it_is_its_role(role):
    everywhere = Grant(name="one", role=role.name, cells=("*",), created=WHEN)
    config = make_access_control("ns", [everywhere])
    assert config["subjects"][-1] == {"id": "one", "cert_common_names": ["one"]}

    def rights(holder: str) -> list[dict[str, object]]:
        rules = {rule["id"]: rule for rule in config["rules"]}
        (policy,) = (each for each in config["policies"] if each["subjects"] == [holder])
        return [rules[number] | {"id": ""} for number in policy["rules"]]

    assert rights("one") == rights(role.name)
    assert len({rule["id"] for rule in config["rules"]}) == len(config["rules"])


def test_what_was_revoked_gives_no_rule():
    gone = GIVEN.model_copy(update={"revoked": WHEN})
    assert make_access_control("ns", [gone]) == make_access_control("ns")
    assert make_access_control("ns", [GIVEN]) != make_access_control("ns")


@pytest.mark.parametrize("pattern", ["sim-0", "sim-*", "s*", "*", "a.b@c_d-1*"])
@pytest.mark.parametrize("cell", ["sim-0", "sim-01", "sim-", "sim", "s", "a.b@c_d-1", "other"])
def test_patterns_mean_to_us_what_they_mean_to_the_router(pattern, cell):
    grant = Grant(name="one", role="gripper", cells=(pattern,), created=WHEN)
    allowed = keys("one", "ingress", "put", grant)
    key = zenoh.KeyExpr(f"ns/cell/{cell}/gripper/state")
    assert includes([pattern], cell) == any(zenoh.KeyExpr(k).includes(key) for k in allowed)


@pytest.mark.parametrize("key", ["cell/*/policy/action", "cell/**", "cell/sim-$*/policy/action"])
def test_no_wildcard_reaches_further(key):
    allowed = keys("policy-gpu1", "ingress", "put", GIVEN)
    assert not any(zenoh.KeyExpr(k).includes(zenoh.KeyExpr(f"ns/{key}")) for k in allowed)


@pytest.mark.parametrize("pattern", ["", "**", "a*b", "*a", "a/b", "a$*", "-a", "a b", "a*\n"])
def test_what_is_no_pattern_is_refused(pattern):
    with pytest.raises(ValidationError):
        TypeAdapter(CellPattern).validate_python(pattern)


def test_what_was_written_is_read(router):
    assert read_grants(router) == Grants()
    folder = add(router)
    assert read_own(folder) == GIVEN
    add(router, "policy-gpu2")
    assert [grant.name for grant in read_grants(router).live] == ["policy-gpu1", "policy-gpu2"]
    assert stat.S_IMODE((router / "grants.json").stat().st_mode) == 0o644
    assert {path.name for path in router.iterdir()} == {"grants.json"}


def test_revoked_is_remembered_and_the_name_is_never_given_again(router):
    add(router)
    add(router, "policy-gpu2")
    before = now()
    revoke_grant(router, "policy-gpu1")
    first, second = read_grants(router).grants
    assert first.revoked is not None
    assert first.revoked >= before
    assert read_grants(router).live == (second,)
    with pytest.raises(InvalidValue, match="not revoked since"):
        revoke_grant(router, "policy-gpu1")
    (router.parent / "policy-gpu1" / "grant.json").unlink()
    (router.parent / "policy-gpu1").rmdir()
    with pytest.raises(InvalidValue, match="never had"):
        add(router)
    assert not (router.parent / "policy-gpu1").exists()
    with pytest.raises(UnknownName, match="policy-gpu1, policy-gpu2"):
        revoke_grant(router, "policy-gpu3")


def test_without_a_certificate_nothing_is_granted(router):
    def fail() -> Path:
        raise InvalidValue("--name", "policy-gpu1", "another")

    with pytest.raises(InvalidValue):
        add_grant(router, GIVEN, issue=fail)
    assert list(router.iterdir()) == []


def test_a_change_that_fails_leaves_the_file_as_it_was(router, monkeypatch):
    add(router)
    before = (router / "grants.json").read_bytes()

    def fail(self, target):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(BadGrants, match="No space left"):
        revoke_grant(router, "policy-gpu1")
    assert (router / "grants.json").read_bytes() == before
    assert {path.name for path in router.iterdir()} == {"grants.json"}


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"role": "control"}, "grants.0.role: .*control is none of"),
        ({"role": "cook"}, "cook is none of"),
        ({"name": "sim"}, "grants.0.name: .*sim is a role"),
        ({"name": "a/b"}, "grants.0.name"),
        ({"cells": []}, "grants.0.cells"),
        ({"cells": ["a*b"]}, "grants.0.cells.0"),
        ({"created": "2026-01-02T00:00:00"}, "grants.0.created: .*timezone"),
        ({"revokd": None}, "grants.0.revokd"),
    ],
)
def test_a_wrong_entry_is_named(router, change, problem):
    entry = GIVEN.model_dump(mode="json") | change
    (router / "grants.json").write_text(json.dumps({"version": 1, "grants": [entry]}))
    with pytest.raises(BadGrants, match=problem) as caught:
        read_grants(router)
    assert caught.value.path == str(router / "grants.json")


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("{", "Invalid JSON"),
        ('{"version": 2, "grants": []}', "version"),
        (Grants.model_construct(grants=(GIVEN, GIVEN)).model_dump_json(), "two grants have one"),
    ],
)
def test_a_broken_file_is_neither_used_nor_changed(router, text, problem):
    (router / "grants.json").write_text(text)
    for use in (
        lambda: read_grants(router),
        lambda: revoke_grant(router, "x"),
        lambda: add(router),
    ):
        with pytest.raises(BadGrants, match=problem):
            use()
    assert (router / "grants.json").read_text() == text


def test_a_file_that_cannot_be_read_or_written_is_named(router):
    # A folder: whoever runs the tests may be allowed to read every file.
    (router / "grants.json").mkdir()
    with pytest.raises(BadGrants, match="Is a directory"):
        read_grants(router)
    with pytest.raises(BadGrants, match="No such file"):
        revoke_grant(router / "none", "policy-gpu1")


def test_the_owner_of_a_cell_without_rights_is_refused():
    check_cell("sim-b2", GIVEN.cells)
    check_cell(None, GIVEN.cells)
    with pytest.raises(InvalidValue, match=r"sim-lab1, sim-b\*"):
        check_cell("sim-0", GIVEN.cells)
