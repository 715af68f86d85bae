"""Who may call what on REST: every route, with every role."""

from __future__ import annotations

import json
import logging

import pytest
from fastapi import APIRouter, FastAPI

from common.api import PREFIX, ProblemDetails
from common.keys import Role, create_key, revoke_key
from common.log import JsonFormatter
from services.control.access import OPERATE, STOP, Guard, GuardedRoute
from services.control.app import create_app
from services.control.keyring import KeyRing
from services.control.problems import add_problem_handlers
from services.control.rate_limit import RateLimit
from tests.control_nodes import usual_nodes
from tests.control_rest import ask, running_plane

EVALUATIONS = f"{PREFIX}/evaluations"
REQUEST = {"tasks": ["lid"], "robots": ["panda"], "policy": "expert", "trials": 1}
OPEN_PATHS = {"/healthz", "/readyz", f"{PREFIX}/healthz", f"{PREFIX}/readyz"}


@pytest.fixture(scope="module")
def plane():
    with running_plane(usual_nodes()) as running:
        yield running.plane


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return tmp_path_factory.mktemp("keys") / "keys.json"


@pytest.fixture(scope="module")
def keys(path):
    return {role: create_key(path, name=f"the-{role}", role=role) for role in Role}


@pytest.fixture
def app(plane, path, keys):
    return create_app(plane, keys=KeyRing(path))


def bearer(key: str) -> dict[str, str]:
    return {"authorization": f"Bearer {key}"}


def problem_of(response, status: int, code: str) -> ProblemDetails:
    assert response.headers["content-type"] == "application/problem+json"
    problem = ProblemDetails.model_validate_json(response.content)
    assert (response.status_code, problem.status, problem.code) == (status, status, code)
    return problem


def calls_of(app) -> list[tuple[str, str, str]]:
    """Method, path with its parts filled in, and stated role of every route."""
    found = [("GET", f"{PREFIX}/openapi.json", "view")]
    for path, methods in app.openapi()["paths"].items():
        for method, said in methods.items():
            filled = path.replace("{trial}", "0").replace("{name}", "x")
            filled = filled.replace("{evaluation}", "e-none").replace("{cell}", "c")
            found.append((method.upper(), filled, said["x-role"]))
    return found


def test_every_route_states_a_role_that_fits_its_method(app):
    calls = calls_of(app)
    assert len(calls) > 15
    for method, path, role in calls:
        if path in OPEN_PATHS:
            assert role == "none"
        elif method == "GET":
            assert role == "view", path
        else:
            assert role in ("operate", "admin"), path
    assert ("POST", EVALUATIONS, "operate") in calls
    assert ("DELETE", f"{EVALUATIONS}/e-none", "operate") in calls
    assert ("PUT", f"{PREFIX}/policies/x", "admin") in calls


def test_every_route_holds_to_what_it_states(path, keys):
    # A plane of its own: the calls that are admitted do something.
    with running_plane(usual_nodes()) as running:
        check_routes(create_app(running.plane, keys=KeyRing(path)), keys)


def check_routes(app, keys):
    for method, path, role in calls_of(app):
        without = ask(app, method, path)
        if role == "none":
            assert without.status_code == 200
            continue
        problem_of(without, 401, "E-KEY")
        for held, key in keys.items():
            answer = ask(app, method, path, headers=bearer(key))
            if held.includes(Role(role)):
                assert answer.status_code not in (401, 403), (method, path, held)
            else:
                problem = problem_of(answer, 403, "E-ROLE")
                assert f"the role {role}" in problem.expected


def test_a_route_without_a_role_cannot_be_made():
    router = APIRouter(route_class=GuardedRoute)
    with pytest.raises(TypeError, match="/new says no role"):
        router.get("/new")(lambda: None)
    with pytest.raises(TypeError, match="/new says no role"):
        router.post("/new", openapi_extra={"x-other": 1})(lambda: None)


def test_every_route_of_the_application_asks_the_guard(app):
    def walk(routes):
        for route in routes:
            inner = getattr(route, "original_router", None)
            yield from walk(inner.routes) if inner is not None else [route]

    found = list(walk(app.routes))
    assert len(found) > 10
    assert all(isinstance(route, GuardedRoute) for route in found)


@pytest.mark.parametrize(
    "header",
    [
        "",
        "Bearer",
        "Bearer ",
        "Bearer legato_x",
        "Basic {key}",
        "{key}",
        "Bearer {key}x",
        "Bearer ü",
    ],
)
def test_what_is_no_key_is_refused(app, keys, header):
    value = header.format(key=keys[Role.ADMIN]).encode("latin-1")
    response = ask(app, "GET", EVALUATIONS, headers={"authorization": value})
    problem = problem_of(response, 401, "E-KEY")
    assert response.headers["www-authenticate"] == 'Bearer realm="legato"'
    assert "LEGATO_API_KEY" in problem.action
    assert keys[Role.ADMIN] not in response.text


def test_a_refusal_comes_before_the_body_is_looked_at(app, keys):
    body = {"content": b"{", "headers": {"content-type": "application/json"}}
    problem_of(ask(app, "POST", EVALUATIONS, **body), 401, "E-KEY")
    body["headers"] |= bearer(keys[Role.VIEW])
    problem_of(ask(app, "POST", EVALUATIONS, **body), 403, "E-ROLE")


def test_a_changed_file_counts_at_once(plane, tmp_path, caplog):
    path = tmp_path / "keys.json"
    first = create_key(path, name="ann", role=Role.VIEW)
    app = create_app(plane, keys=KeyRing(path))
    second = create_key(path, name="bob", role=Role.VIEW)
    for key in (first, second):
        assert ask(app, "GET", EVALUATIONS, headers=bearer(key)).status_code == 200
    revoke_key(path, name="ann")
    problem_of(ask(app, "GET", EVALUATIONS, headers=bearer(first)), 401, "E-KEY")
    assert ask(app, "GET", EVALUATIONS, headers=bearer(second)).status_code == 200
    path.unlink()
    answer = ask(app, "GET", EVALUATIONS, headers=bearer(second))
    problem_of(answer, 401, "E-KEY")
    assert str(path) not in answer.text
    assert [r.message for r in caplog.records if r.levelname == "ERROR"] == ["nobody is let in"]


def test_without_keys_everybody_may_do_everything(plane):
    assert ask(create_app(plane), "POST", EVALUATIONS, json=REQUEST).status_code == 202
    headers = bearer("legato_of-another-site")
    assert ask(create_app(plane), "GET", EVALUATIONS, headers=headers).status_code == 200


def test_too_many_writing_calls_are_refused_for_this_key_alone(plane, path, keys):
    limit = RateLimit(rate_hz=0.5, burst=2, now_s=lambda: 0.0)
    app = create_app(plane, keys=KeyRing(path), limit=limit)
    operate, admin = (bearer(keys[role]) for role in (Role.OPERATE, Role.ADMIN))
    answers = [ask(app, "POST", EVALUATIONS, json={}, headers=operate) for _ in range(3)]
    assert [answer.status_code for answer in answers] == [422, 422, 429]
    problem = problem_of(answers[2], 429, "E-TOO-MANY-CALLS")
    assert answers[2].headers["retry-after"] == "2"
    assert problem.action == "wait 2 s"
    assert ask(app, "GET", EVALUATIONS, headers=operate).status_code == 200
    assert ask(app, "POST", EVALUATIONS, json={}, headers=admin).status_code == 422


@pytest.mark.parametrize("with_keys", [True, False])
def test_calls_without_a_key_are_counted_by_address(plane, path, keys, with_keys):
    limit = RateLimit(rate_hz=1, burst=2, now_s=lambda: 0.0)
    app = create_app(plane, keys=KeyRing(path) if with_keys else None, limit=limit)
    answers = [ask(app, "POST", EVALUATIONS, json={}) for _ in range(3)]
    first = 401 if with_keys else 422
    assert [answer.status_code for answer in answers] == [first, first, 429]
    key = bearer(keys[Role.VIEW])
    assert ask(app, "GET", EVALUATIONS, headers=key).status_code == 200


def test_no_page_of_another_site_may_read(app, keys):
    headers = bearer(keys[Role.ADMIN]) | {"origin": "http://elsewhere.example"}
    answer = ask(app, "GET", EVALUATIONS, headers=headers)
    assert not [name for name in answer.headers if name.startswith("access-control")]
    asked = headers | {"access-control-request-method": "POST"}
    assert ask(app, "OPTIONS", EVALUATIONS, headers=asked).status_code == 405


@pytest.mark.parametrize(
    ("origin", "admitted"),
    [
        ("http://127.0.0.1:8000", True),
        ("http://localhost:3000", True),
        ("http://[::1]:8000", True),
        ("http://elsewhere.example", False),
        ("http://127.0.0.1.elsewhere.example", False),
        ("http://10.0.0.7:8000", False),
        ("null", False),
        ("http://[", False),
    ],
)
def test_without_keys_only_pages_of_this_machine_may_call(plane, origin, admitted):
    # As a form of another page sends it, which no browser asks about first.
    headers = {"origin": origin, "content-type": "text/plain"}
    answer = ask(create_app(plane), "DELETE", f"{EVALUATIONS}/e-none", headers=headers)
    if admitted:
        problem_of(answer, 404, "E-NOT-FOUND")
    else:
        problem_of(answer, 403, "E-ORIGIN")


def audited(caplog) -> list[dict]:
    lines = [JsonFormatter("control").format(record) for record in caplog.records]
    return [line for line in map(json.loads, lines) if line["event"] == "call"]


def test_operating_calls_are_written_down_and_reading_ones_are_not(app, keys, caplog):
    caplog.set_level(logging.INFO)
    operate, view = (bearer(keys[role]) for role in (Role.OPERATE, Role.VIEW))
    made = ask(app, "POST", EVALUATIONS, json=REQUEST, headers=operate)
    ask(app, "GET", EVALUATIONS, headers=operate)
    ask(app, "DELETE", f"{EVALUATIONS}/e-none", headers=operate)
    ask(app, "POST", EVALUATIONS, json=REQUEST, headers=view)
    ask(app, "GET", EVALUATIONS)
    lines = audited(caplog)
    assert [
        (line["caller"], line["role"], line["method"], line["path"], line["status"])
        for line in lines
    ] == [
        ("the-operate", "operate", "POST", EVALUATIONS, 202),
        ("the-operate", "operate", "DELETE", f"{EVALUATIONS}/e-none", 404),
        ("the-view", "view", "POST", EVALUATIONS, 403),
        (None, None, "GET", EVALUATIONS, 401),
    ]
    assert lines[0]["made"] == made.headers["location"]
    assert [line["level"] for line in lines] == ["info", "warning", "warning", "warning"]
    assert all(line["address"] == "127.0.0.1" for line in lines)
    assert not any(key in line for key in keys.values() for line in map(json.dumps, lines))


def test_a_call_that_fails_unexpectedly_is_written_down_too(app, plane, keys, caplog, monkeypatch):
    def fail(*_):
        raise RuntimeError

    caplog.set_level(logging.INFO)
    monkeypatch.setattr(plane.store, "create", fail)
    headers = bearer(keys[Role.OPERATE])
    assert ask(app, "POST", EVALUATIONS, json=REQUEST, headers=headers).status_code == 500
    (line,) = audited(caplog)
    assert (line["caller"], line["status"]) == ("the-operate", 500)


def test_an_emergency_stop_is_never_one_call_too_many(path, keys):
    limit = RateLimit(rate_hz=1, burst=1, now_s=lambda: 0.0)
    app = FastAPI()
    app.state.guard = Guard(KeyRing(path), limit)
    add_problem_handlers(app)
    router = APIRouter(route_class=GuardedRoute)
    router.post("/start", openapi_extra=OPERATE)(lambda: None)
    router.post("/stop", openapi_extra=STOP)(lambda: None)
    app.include_router(router)
    headers = bearer(keys[Role.OPERATE])
    answers = [ask(app, "POST", path, headers=headers) for path in ["/start"] * 2 + ["/stop"] * 3]
    assert [answer.status_code for answer in answers] == [200, 429, 200, 200, 200]
    problem_of(ask(app, "POST", "/stop", headers=bearer(keys[Role.VIEW])), 403, "E-ROLE")
