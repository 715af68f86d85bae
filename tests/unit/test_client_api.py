from __future__ import annotations

import contextlib

import httpx
import pytest

from client.api import LegatoClient
from client.errors import ControlUnreachable, NotLegato, RestError
from client.sse import parse_events
from common.api import ProblemDetails, ProgressEvent, TaskInfo
from tests.client_samples import make_evaluation, make_request, make_trial

PROBLEM = ProblemDetails(
    type="about:blank",
    title="Unknown name",
    status=422,
    detail='no task "lidd"',
    code="E-UNKNOWN-NAME",
    expected="known: lid",
    action="did you mean: lid",
)


def open_client(handler, **options) -> LegatoClient:
    return LegatoClient("http://test", transport=httpx.MockTransport(handler), **options)


def answer(model, status=200) -> httpx.Response:
    return httpx.Response(status, text=model.model_dump_json())


def event(name: str, model) -> str:
    return f"event: {name}\ndata: {model.model_dump_json()}\n\n"


def test_submit_posts_the_request_and_reads_the_evaluation():
    seen = {}

    def handler(request: httpx.Request) -> httpx.Response:
        seen["call"] = (request.method, request.url.path)
        seen["body"] = request.read()
        return answer(make_evaluation(), 201)

    with open_client(handler) as client:
        assert client.submit(make_request()) == make_evaluation()
    assert seen["call"] == ("POST", "/api/v1/evaluations")
    assert type(make_request()).model_validate_json(seen["body"]) == make_request()


@pytest.mark.parametrize(
    ("call", "method", "path"),
    [
        (lambda c: c.evaluation("e-1"), "GET", "/api/v1/evaluations/e-1"),
        (lambda c: c.cancel("e-1"), "DELETE", "/api/v1/evaluations/e-1"),
    ],
)
def test_paths_of_one_evaluation(call, method, path):
    def handler(request: httpx.Request) -> httpx.Response:
        assert (request.method, request.url.path) == (method, path)
        return answer(make_evaluation())

    with open_client(handler) as client:
        assert call(client).id == "e-1"


def test_lists_are_typed():
    answers = {
        "/api/v1/evaluations": [make_evaluation()],
        "/api/v1/evaluations/e-1/trials": [make_trial()],
        "/api/v1/tasks": [TaskInfo(name="lid", title="Lid", time_limit_s=20.0)],
        "/api/v1/robots": [],
        "/api/v1/policies": [],
        "/api/v1/services": [],
    }

    def handler(request: httpx.Request) -> httpx.Response:
        items = answers[request.url.path]
        return httpx.Response(200, json=[item.model_dump(mode="json") for item in items])

    with open_client(handler) as client:
        assert client.evaluations() == [make_evaluation()]
        assert client.trials("e-1") == [make_trial()]
        assert client.tasks()[0].name == "lid"
        assert client.robots() == client.policies() == client.services() == []


def test_picture_gives_the_bytes():
    def handler(request: httpx.Request) -> httpx.Response:
        assert request.url.path == "/api/v1/evaluations/e-1/trials/3/pictures/start-scene"
        return httpx.Response(200, content=b"png")

    with open_client(handler) as client:
        assert client.picture("e-1", 3, "start-scene") == b"png"


def test_a_refusal_keeps_the_code_of_the_control_plane():
    with (
        open_client(lambda _: answer(PROBLEM, 422)) as client,
        pytest.raises(RestError) as caught,
    ):
        client.submit(make_request())
    assert caught.value.problem == PROBLEM
    assert caught.value.describe()["code"] == "E-UNKNOWN-NAME"
    assert str(caught.value) == 'no task "lidd"; known: lid; did you mean: lid'


def test_an_error_without_problem_details_is_not_legato():
    with (
        open_client(lambda _: httpx.Response(502, text="bad gateway")) as client,
        pytest.raises(NotLegato, match="502"),
    ):
        client.services()


def test_an_answer_that_does_not_validate_names_the_field():
    with (
        open_client(lambda _: httpx.Response(200, json={"id": "e-1"})) as client,
        pytest.raises(NotLegato, match="status"),
    ):
        client.evaluation("e-1")


def test_the_key_goes_with_every_call_and_into_no_error(monkeypatch):
    seen = []
    refusal = PROBLEM.model_copy(update={"status": 401, "code": "E-KEY"})

    def handler(request: httpx.Request) -> httpx.Response:
        seen.append((request.url.path, request.headers.get("authorization")))
        return answer(refusal, 401)

    def call_all(client: LegatoClient) -> None:
        for call in (client.robots, lambda: client.submit(make_request()), client.ready):
            with contextlib.suppress(RestError):
                call()
        with pytest.raises(RestError) as caught:
            list(client.events("e-1"))
        assert "legato_x" not in f"{caught.value!r} {caught.value.describe()}"
        assert len(seen) == 4

    with open_client(handler, api_key="legato_x") as client:
        call_all(client)
    assert {key for _, key in seen} == {"Bearer legato_x"}
    seen.clear()
    monkeypatch.setenv("LEGATO_API_KEY", "legato_y")
    with open_client(handler) as client:
        call_all(client)
    assert {key for _, key in seen} == {"Bearer legato_y"}
    seen.clear()
    monkeypatch.delenv("LEGATO_API_KEY")
    with open_client(handler) as client:
        call_all(client)
    assert {key for _, key in seen} == {None}


def refuse(request: httpx.Request) -> httpx.Response:
    raise httpx.ConnectError("[Errno 111] Connection refused", request=request)


def test_a_refused_connection_says_what_to_run():
    with open_client(refuse) as client, pytest.raises(ControlUnreachable) as caught:
        client.robots()
    assert "no control plane at http://test (connection refused)" in str(caught.value)
    assert caught.value.action == "run: legato up"


def test_ready_is_false_when_nothing_answers_or_it_says_so():
    with open_client(refuse) as client:
        assert not client.ready()
    with open_client(lambda _: answer(PROBLEM, 503)) as client:
        assert not client.ready()
    with open_client(lambda _: httpx.Response(200, json={})) as client:
        assert client.ready()


def test_events_end_at_the_end_event():
    first = ProgressEvent(evaluation=make_evaluation(status="running"), trial=make_trial())
    last = ProgressEvent(evaluation=make_evaluation())
    stream = ": hello\n\n" + event("progress", first) + event("progress", last)
    stream += "event: end\ndata: {}\n\n" + event("progress", first)

    with open_client(lambda _: httpx.Response(200, text=stream)) as client:
        assert list(client.events("e-1")) == [first, last]


def test_events_open_a_broken_stream_again(monkeypatch):
    monkeypatch.setattr("time.sleep", lambda _: None)
    first = ProgressEvent(evaluation=make_evaluation(status="running"))
    answers = iter(
        [
            httpx.Response(200, text=event("progress", first)),
            None,
            httpx.Response(200, text="event: end\ndata: {}\n\n"),
        ]
    )

    def handler(request: httpx.Request) -> httpx.Response:
        if request.url.path.endswith("/events"):
            return next(answers) or refuse(request)
        return answer(make_evaluation())

    with open_client(handler) as client:
        assert client.wait("e-1") == make_evaluation()
    assert next(answers, "used up") == "used up"


def test_events_give_up_when_the_control_plane_stays_away():
    with (
        open_client(refuse, reconnect_s=0.0) as client,
        pytest.raises(ControlUnreachable, match="connection refused"),
    ):
        list(client.events("e-1"))


def test_events_of_an_unknown_evaluation_are_refused():
    gone = PROBLEM.model_copy(update={"status": 404, "code": "E-NOT-FOUND"})
    with open_client(lambda _: answer(gone, 404)) as client, pytest.raises(RestError):
        list(client.events("nope"))


def test_parse_events_joins_data_and_drops_what_is_cut_off():
    lines = ["event: a", "data: 1", "data:2", "id: 9", "", ": note", "", "data: 3", "", "data: 4"]
    assert [(e.name, e.data) for e in parse_events(lines)] == [("a", "1\n2"), ("message", "3")]
