"""What REST refuses, and that every refusal is problem details that help."""

from __future__ import annotations

import json

import pytest

from common.api import PREFIX, ProblemDetails
from services.control.body_limit import MAX_BODY_BYTES
from tests.control_nodes import FakeGripper, FakePolicy, FakeRetarget, FakeSim, usual_nodes
from tests.control_rest import running_plane

EVALUATIONS = f"{PREFIX}/evaluations"
JSON = {"content-type": "application/json"}


@pytest.fixture(scope="module")
def rest():
    with running_plane(usual_nodes()) as running:
        yield running


def problem_of(response, status):
    assert response.headers["content-type"] == "application/problem+json"
    problem = ProblemDetails.model_validate_json(response.content)
    assert (response.status_code, problem.status) == (status, status)
    assert problem.detail
    assert problem.expected
    assert problem.action
    return problem


@pytest.mark.parametrize(
    ("fields", "field", "code", "action"),
    [
        ({"tasks": ["lidd"]}, "tasks", "E-UNKNOWN-NAME", "did you mean: lid"),
        ({"robots": ["pnda"]}, "robots", "E-UNKNOWN-NAME", "did you mean: panda"),
        ({"policy": "expret"}, "policy", "E-UNKNOWN-NAME", "did you mean: expert"),
        ({"camera": "t256"}, "camera", "E-UNKNOWN-NAME", "did you mean: t265"),
        ({"trials": 0}, "trials", "E-INVALID-VALUE", "change trials"),
        ({"trials": -3}, "trials", "E-INVALID-VALUE", "change trials"),
        ({"trials": True}, "trials", "E-INVALID-VALUE", "change trials"),
        ({"trials": 1.5}, "trials", "E-INVALID-VALUE", "change trials"),
        ({"trials": 10**30}, "trials", "E-INVALID-VALUE", "change trials"),
        ({"seed": -1}, "seed", "E-INVALID-VALUE", "change seed"),
        ({"seed": False}, "seed", "E-INVALID-VALUE", "change seed"),
        ({"mode": "fast"}, "mode", "E-INVALID-VALUE", "change mode"),
        ({"action_latency_s": 2}, "action_latency_s", "E-INVALID-VALUE", "change action_latency_s"),
        ({"robots": []}, "robots", "E-INVALID-VALUE", "change robots"),
        ({"robots": ["../etc"]}, "robots.0", "E-INVALID-VALUE", "change robots.0"),
        ({"robots": ["panda", "panda"]}, "body", "E-INVALID-VALUE", "change body"),
        ({"policies": ["expert"]}, "body", "E-INVALID-VALUE", "change body"),
        ({"speed": 3}, "speed", "E-INVALID-VALUE", "change speed"),
    ],
)
def test_wrong_field_is_named(rest, fields, field, code, action):
    response = rest.post(**fields)
    problem = problem_of(response, 422)
    (error,) = problem.errors
    assert (error["field"], error["code"], error["action"]) == (field, code, action)
    assert (problem.code, problem.detail) == (code, error["happened"])


def test_every_unknown_name_is_reported(rest):
    response = rest.post(tasks=["lidd"], robots=["panda", "pnda"], policy="x", camera="y")
    problem = problem_of(response, 422)
    assert [error["field"] for error in problem.errors] == ["tasks", "robots", "camera", "policy"]
    assert problem.errors[1]["happened"] == 'no robot "pnda"'
    assert problem.errors[1]["expected"] == "known: abstract, panda, spot"


def test_every_wrong_value_is_reported(rest):
    problem = problem_of(rest.post(trials=0, seed=-1, mode="x"), 422)
    assert {error["field"] for error in problem.errors} == {"trials", "seed", "mode"}


def test_missing_field_is_named(rest):
    problem = problem_of(rest.request("POST", EVALUATIONS, json={}), 422)
    assert [error["happened"] for error in problem.errors] == [
        "tasks is missing",
        "robots is missing",
    ]


@pytest.mark.parametrize("body", [b"{", b"lid", b"\xff\xfe", b"[" * 100_000])
def test_body_that_is_not_json(rest, body):
    problem = problem_of(rest.request("POST", EVALUATIONS, content=body, headers=JSON), 400)
    assert problem.code == "E-BODY"


@pytest.mark.parametrize("body", [b"", b"null", b"3", b"[]", b'"lid"'])
def test_body_that_is_no_request(rest, body):
    problem_of(rest.request("POST", EVALUATIONS, content=body, headers=JSON), 422)


def test_body_of_another_type(rest):
    body = json.dumps({"tasks": ["lid"]}).encode()
    headers = {"content-type": "text/plain"}
    problem_of(rest.request("POST", EVALUATIONS, content=body, headers=headers), 422)


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999"])
@pytest.mark.parametrize("field", ["action_latency_s", "trials", "unknown"])
def test_numbers_that_are_not_finite_are_refused(rest, number, field):
    body = f'{{"tasks":["lid"],"robots":["panda"],"policy":"expert","{field}":{number}}}'
    response = rest.request("POST", EVALUATIONS, content=body.encode(), headers=JSON)
    problem = problem_of(response, 422)
    assert [error["field"] for error in problem.errors] == [field]


@pytest.mark.parametrize("announced", [True, False])
def test_body_that_is_too_large(rest, announced):
    async def chunks():
        for _ in range(MAX_BODY_BYTES // 65536 + 1):
            yield b" " * 65536

    content = b" " * (MAX_BODY_BYTES + 1) if announced else chunks()
    problem = problem_of(rest.request("POST", EVALUATIONS, content=content, headers=JSON), 413)
    assert problem.code == "E-TOO-LARGE"


def test_body_of_the_largest_size_is_read(rest):
    body = b" " * (MAX_BODY_BYTES - 2) + b"{}"
    problem_of(rest.request("POST", EVALUATIONS, content=body, headers=JSON), 422)


@pytest.mark.parametrize(
    "path",
    [
        "/evaluations/e-none",
        "/evaluations/e-none/trials",
        "/evaluations/e-none/events",
        "/evaluations/e-none/trials/0/pictures/end-scene",
    ],
)
def test_unknown_evaluation(rest, path):
    problem = problem_of(rest.get(path), 404)
    assert (problem.code, problem.detail) == ("E-NOT-FOUND", 'no evaluation "e-none"')
    assert problem.action == "list them with: GET /api/v1/evaluations"


def test_unknown_picture_says_where_pictures_are_listed(rest):
    evaluation = rest.post().json()["id"]
    rest.wait_for_end(evaluation)
    problem = problem_of(rest.get(f"/evaluations/{evaluation}/trials/0/pictures/none"), 404)
    assert problem.action == f"list them with: GET /api/v1/evaluations/{evaluation}/trials"


@pytest.mark.parametrize(
    "query", ["limit=0", "limit=x", "limit=1001", "offset=-1", f"offset={2**70}"]
)
def test_wrong_query(rest, query):
    field = query.partition("=")[0]
    problem = problem_of(rest.get(f"/evaluations?{query}"), 422)
    assert problem.errors[0]["field"] == field


@pytest.mark.parametrize("trial", ["x", "-1", str(2**70)])
def test_wrong_trial_number(rest, trial):
    problem_of(rest.get(f"/evaluations/e-none/trials/{trial}/pictures/a"), 422)


def test_unknown_path_and_method(rest):
    assert problem_of(rest.get("/nothing"), 404).code == "E-NOT-FOUND"
    response = rest.request("PATCH", EVALUATIONS)
    assert problem_of(response, 405).code == "E-METHOD"
    assert response.headers["allow"]


def test_unexpected_error_keeps_its_traceback_in_the_log(rest, monkeypatch, caplog):
    def fail():
        raise RuntimeError("secret words")

    monkeypatch.setattr(rest.plane.deployment, "policies", fail)
    response = rest.get("/policies")
    assert problem_of(response, 500).code == "E-INTERNAL"
    assert "secret" not in response.text
    assert "Traceback" not in response.text
    assert "secret words" in caplog.text


@pytest.mark.parametrize(
    ("nodes", "needed"),
    [
        ([FakeSim("s"), FakeGripper("g")], "a policy service"),
        ([FakeSim("s"), FakePolicy("p", policies=["expert"])], "a gripper service"),
        ([FakeGripper("g"), FakePolicy("p", policies=["expert"])], "a sim service"),
        (
            [FakeSim("s"), FakeGripper("g"), FakePolicy("p", policies=["expert"])],
            "a retarget service for panda",
        ),
    ],
)
def test_service_that_does_not_run_is_named(nodes, needed):
    with running_plane(nodes) as rest:
        problem = problem_of(rest.post(), 503)
        assert (problem.code, problem.detail) == ("E-NOT-READY", f"{needed} is not running")
        assert f"{nodes[0].kind} {nodes[0].node}" in problem.expected
        assert rest.get("/evaluations").json() == []


def test_robot_without_a_retargeter_is_named_beside_those_that_have_one(rest):
    problem = problem_of(rest.post(robots=["panda", "spot"]), 503)
    assert problem.detail == "a retarget service for spot is not running"


def test_readiness_names_what_is_missing(rest):
    assert rest.request("GET", "/readyz").status_code == 200
    assert rest.get("/readyz").status_code == 200
    assert rest.request("GET", "/healthz").json() == {"status": "alive"}
    with running_plane([FakeSim("s"), FakeRetarget("r", robots=["panda"])]) as other:
        problem = problem_of(other.request("GET", "/readyz"), 503)
        assert problem.detail == "gripper, policy is not running"
        assert other.request("GET", "/healthz").status_code == 200
