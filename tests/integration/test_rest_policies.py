"""Loading checkpoints over REST: policies appear and change while everything runs."""

from __future__ import annotations

from dataclasses import replace

import pytest

from common.api import PREFIX, Evaluation, PolicyInfo
from common.errors import NodeTimeout
from common.messages import NodeDown, NodeUp
from services.control.loads import LoadRefused, LoadWaiters
from tests.control_nodes import FakeGripper, FakePolicy, FakeRetarget, FakeSim, make_checkpoint
from tests.control_rest import running_plane


@pytest.fixture
def rest():
    nodes = [
        FakeSim("sim-0"),
        FakeRetarget("retarget", robots=["panda"]),
        FakeGripper("gripper"),
        FakePolicy("policy-0", policies=["expert"]),
        FakePolicy("policy-1", policies=["expert"]),
    ]
    with running_plane(nodes) as running:
        running.wait_until(lambda: len(running.plane.deployment.ready("policy")) == 2)
        yield running


def put(rest, name: str, **body):
    return rest.request("PUT", f"{PREFIX}/policies/{name}", json=body)


def infos(rest) -> dict[str, PolicyInfo]:
    found = [PolicyInfo.model_validate(each) for each in rest.get("/policies").json()]
    return {info.name: info for info in found}


def test_a_checkpoint_is_loaded_listed_and_evaluated(rest):
    response = put(rest, "lid-1", folder="runs/lid")
    assert response.status_code == 200
    loaded = PolicyInfo.model_validate_json(response.content)
    expected = make_checkpoint("runs/lid")
    assert loaded.checkpoints == {"policy-0": expected, "policy-1": expected}
    assert infos(rest) == {
        "expert": PolicyInfo(name="expert", nodes=["policy-0", "policy-1"]),
        "lid-1": loaded,
    }
    accepted = rest.post(policy="lid-1")
    done = rest.wait_for_end(accepted.json()["id"])
    assert done.cells[0].successes == 1
    assert done.versions["policy lid-1"] == expected.sha256


def test_a_load_replaces_and_an_evaluation_says_what_it_ran(rest):
    hashes = []
    for folder in ("one", "two"):
        assert put(rest, "lid-1", folder=folder).status_code == 200
        done: Evaluation = rest.wait_for_end(rest.post(policy="lid-1").json()["id"])
        hashes.append(done.versions["policy lid-1"])
    assert hashes == [make_checkpoint(folder).sha256 for folder in ("one", "two")]


def test_a_policy_service_that_starts_again_gets_its_policies_back(rest):
    assert put(rest, "lid-1", folder="one").status_code == 200
    before = infos(rest)["lid-1"]
    evaluation = restart_with(rest, "policy-1", before_it_is_up=lambda: rest.post(policy="lid-1"))
    rest.wait_until(lambda: infos(rest)["lid-1"] == before)
    done = rest.wait_for_end(evaluation.json()["id"])
    assert done.versions["policy lid-1"] == make_checkpoint("one").sha256


def restart_with(rest, node: str, *, before_it_is_up):
    """End a policy service, which forgets what it loaded, and start it again."""
    rest.host.inbox.put_event(NodeDown("policy", node))
    rest.wait_until(lambda: infos(rest)["lid-1"].nodes == ["policy-0"])
    rest.nodes[node].loaded.clear()
    result = before_it_is_up()
    rest.host.inbox.put_event(NodeUp("policy", node))
    return result


def test_one_service_can_be_chosen(rest):
    assert put(rest, "lid-1", folder="one", node="policy-1").status_code == 200
    assert infos(rest)["lid-1"].nodes == ["policy-1"]
    response = put(rest, "lid-1", folder="one", node="policy-2")
    assert (response.status_code, response.json()["code"]) == (422, "E-UNKNOWN-NAME")


def test_a_refusal_keeps_the_words_of_the_service(rest):
    response = put(rest, "lid-1", folder="broken")
    assert response.status_code == 422
    problem = response.json()
    assert (problem["code"], problem["detail"]) == ("E-BROKEN", "policy-0: it broke")
    assert "lid-1" not in infos(rest)


@pytest.mark.parametrize(
    "body", [{}, {"folder": ""}, {"folder": "x", "nodes": ["a"]}, {"folder": 3}]
)
def test_a_wrong_body_is_refused(rest, body):
    assert put(rest, "lid-1", **body).json()["code"] == "E-INVALID-VALUE"


def test_a_task_it_was_not_trained_for_is_refused_before_anything_runs(rest):
    put(rest, "lid-1", folder="one")
    (lid,) = rest.plane.catalog.tasks
    tasks = (lid, lid.model_copy(update={"name": "cup"}))
    rest.plane = replace(rest.plane, catalog=replace(rest.plane.catalog, tasks=tasks))
    response = rest.post(tasks=["lid", "cup"], policies=["expert", "lid-1"], policy=None)
    assert response.status_code == 422
    (error,) = response.json()["errors"]
    assert (error["field"], error["code"]) == ("tasks", "E-UNTRAINED-TASK")


def test_trials_wait_while_their_policy_is_being_loaded(rest):
    """What ran is what the evaluation says: nothing starts between two checkpoints."""
    put(rest, "lid-1", folder="one", node="policy-0")
    policy = rest.nodes["policy-0"]
    policy.silent.set()
    (order,) = rest.plane.deployment.loads.open("lid-1", "two", ["policy-0"])
    rest.plane.send(order)
    evaluation = rest.post(policy="lid-1").json()["id"]
    rest.wait_until(lambda: rest.plane.evaluation(evaluation).waiting_for)
    assert rest.nodes["sim-0"].configured == []
    # The service dies over it and another one takes its place.
    rest.host.inbox.put_event(NodeDown("policy", "policy-0"))
    with pytest.raises(LoadRefused, match="policy-0 is not running"):
        rest.plane.deployment.loads.wait([order], timeout_s=30.0)
    assert put(rest, "lid-1", folder="three", node="policy-1").status_code == 200
    done = rest.wait_for_end(evaluation)
    assert done.versions["policy lid-1"] == make_checkpoint("three").sha256


def test_no_service_at_all_is_said(rest):
    for node in ("policy-0", "policy-1"):
        rest.host.inbox.put_event(NodeDown("policy", node))
    rest.wait_until(lambda: not rest.plane.deployment.ready("policy"))
    response = put(rest, "lid-1", folder="one")
    assert (response.status_code, response.json()["code"]) == (503, "E-NOT-READY")


def test_silence_is_a_time_out_and_leaves_nothing_behind():
    waiters = LoadWaiters()
    orders = waiters.open("lid-1", "one", ["policy-0"])
    with pytest.raises(NodeTimeout, match="policy-0 sent no PolicyLoaded"):
        waiters.wait(orders, timeout_s=0.01)
    assert waiters._answers == {}
