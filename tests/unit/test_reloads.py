"""What a policy service was told to load it is told again when it has started again."""

from __future__ import annotations

import logging

import pytest

from common.messages import (
    EpisodeConfigure,
    Header,
    NodeDown,
    NodeUp,
    PolicyLoad,
    PolicyLoaded,
    Problem,
)
from services.control.events import LoadPolicy, PolicyLoadEnded
from tests.control_nodes import make_checkpoint
from tests.unit.test_scheduler import Bench, describe, one, only


def answer(load: PolicyLoad, *, problem: str = "") -> PolicyLoaded:
    return PolicyLoaded(
        header=Header(),
        request=load.request,
        node=load.node,
        policy=load.policy,
        checkpoint=None if problem else make_checkpoint(load.folder),
        problem=Problem(code="E-X", happened=problem, expected="e", action="a")
        if problem
        else None,
    )


def load(bench: Bench, policy: str, folder: str) -> None:
    """As over REST."""
    order = LoadPolicy(f"l-{policy}-{folder}", "policy", policy, folder)
    asked = one(PolicyLoad, bench.give(order))
    assert one(PolicyLoadEnded, bench.give(answer(asked))).problem is None


def restart(bench: Bench) -> list[PolicyLoad]:
    """The service dies and comes back; what it is told."""
    bench.down(("policy", "policy"))
    return only(PolicyLoad, bench.up("policy", "policy"))


@pytest.fixture
def bench() -> Bench:
    bench = Bench()
    load(bench, "a", "one")
    load(bench, "b", "two")
    return bench


def test_all_is_loaded_again_one_after_the_other(bench: Bench):
    (first,) = restart(bench)
    second = one(PolicyLoad, bench.give(answer(first)))
    told = [(each.policy, each.folder) for each in (first, second)]
    assert sorted(told) == [("a", "one"), ("b", "two")]
    assert first.request != second.request
    assert only(PolicyLoad, bench.give(answer(second))) == []
    # And at every further start.
    assert len(restart(bench)) == 1


def test_the_last_folder_of_a_name_counts(bench: Bench):
    load(bench, "a", "three")
    (first,) = restart(bench)
    second = one(PolicyLoad, bench.give(answer(first)))
    assert {each.policy: each.folder for each in (first, second)} == {"a": "three", "b": "two"}


def test_no_trial_starts_before_all_is_loaded(bench: Bench):
    """Not even one of another policy: a service that loads does not act."""
    (first,) = restart(bench)
    assert only(EpisodeConfigure, bench.submit(policy="b")) == []
    second = one(PolicyLoad, bench.give(answer(first)))
    out = bench.give(answer(second)) + bench.tick()
    assert one(EpisodeConfigure, out).policy == "b"


def test_a_second_description_on_the_way_skips_nothing(bench: Bench):
    (first,) = restart(bench)
    assert only(PolicyLoad, bench.give(describe("policy", "policy"))) == []
    second = one(PolicyLoad, bench.give(answer(first)))
    assert {first.policy, second.policy} == {"a", "b"}


def test_a_load_that_fails_is_told_and_not_tried_again(bench: Bench, caplog):
    (first,) = restart(bench)
    with caplog.at_level(logging.WARNING):
        second = one(PolicyLoad, bench.give(answer(first, problem="it broke")))
    (record,) = caplog.records
    assert (record.policy, record.reason) == (first.policy, "it broke")
    bench.give(answer(second))
    (again,) = restart(bench)
    assert again.policy == second.policy
    assert only(PolicyLoad, bench.give(answer(again))) == []


def test_a_load_that_ends_the_service_does_not_end_it_twice(bench: Bench, caplog):
    (first,) = restart(bench)
    with caplog.at_level(logging.WARNING):
        (second,) = restart(bench)
    assert [(each.policy, each.reason) for each in caplog.records] == [
        (first.policy, "the service ended")
    ]
    assert second.policy != first.policy
    assert only(PolicyLoad, bench.give(answer(second))) == []


def test_a_service_whose_link_was_lost_is_told_nothing(bench: Bench):
    """It still has what it loaded, and is told once it has not."""
    bench.down(("policy", "policy"))
    checkpoints = {"a": make_checkpoint("one"), "b": make_checkpoint("two")}
    described = describe("policy", "policy").model_copy(update={"checkpoints": checkpoints})
    assert only(PolicyLoad, bench.give(NodeUp("policy", "policy"), described)) == []
    assert len(restart(bench)) == 1


def test_what_a_service_starts_with_under_the_same_name_is_replaced(bench: Bench):
    bench.give(NodeDown("policy", "policy"))
    started_with = {"a": make_checkpoint("shipped")}
    described = describe("policy", "policy").model_copy(update={"checkpoints": started_with})
    first = one(PolicyLoad, bench.give(NodeUp("policy", "policy"), described))
    assert (first.policy, first.folder) == ("a", "one")


def test_another_service_is_told_nothing(bench: Bench):
    assert only(PolicyLoad, bench.up("policy", "policy-2")) == []


def test_a_failed_first_load_is_nobodys_warning(bench: Bench, caplog):
    """Whoever asked is told."""
    asked = one(PolicyLoad, bench.give(LoadPolicy("l-1", "policy", "c", "none")))
    with caplog.at_level(logging.WARNING):
        ended = one(PolicyLoadEnded, bench.give(answer(asked, problem="no such folder")))
    assert ended.problem is not None
    assert caplog.records == []
    (first,) = restart(bench)
    second = one(PolicyLoad, bench.give(answer(first)))
    assert {first.policy, second.policy} == {"a", "b"}
