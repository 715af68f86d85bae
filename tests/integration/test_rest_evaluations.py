"""Evaluations from request to result, over REST and the bus of one process."""

from __future__ import annotations

import asyncio
import io
import threading

import pytest
from PIL import Image

from client.sse import parse_events
from common.api import PREFIX, Evaluation, PolicyInfo, ProgressEvent, RobotInfo, ServiceInfo, Trial
from common.messages import NodeDown, NodeUp, Problem
from services.control import sse
from services.control.database import database_url
from tests.control_nodes import make_result, usual_nodes
from tests.control_rest import WAIT_S, running_plane


@pytest.fixture
def rest():
    with running_plane(usual_nodes(cells=2)) as running:
        yield running


def events_of(response):
    return list(parse_events([*response.text.splitlines(), ""]))


def test_grid_is_evaluated_and_summarised(rest):
    rest.nodes["sim-0"].judge = rest.nodes["sim-1"].judge = lambda configure: make_result(
        "failure" if configure.robot == "panda" else "success", seed=configure.seed
    )
    response = rest.post(robots=["abstract", "panda"], trials=3, seed=5)
    assert response.status_code == 202
    accepted = Evaluation.model_validate_json(response.content)
    assert response.headers["location"] == f"{PREFIX}/evaluations/{accepted.id}"
    assert accepted.trials_total == 6

    rest.wait_for_end(accepted.id)
    done = Evaluation.model_validate_json(rest.get(f"/evaluations/{accepted.id}").content)
    assert (done.status, done.trials_done) == ("done", 6)
    abstract, panda = done.cells
    assert (abstract.successes, panda.failures) == (3, 3)
    assert abstract.trace_sha256 == panda.trace_sha256
    assert len(set(panda.trace_sha256)) == 3
    assert set(done.versions) == {"legato", "numpy"}
    assert [e["id"] for e in rest.get("/evaluations").json()] == [accepted.id]

    trials = [Trial.model_validate(t) for t in rest.get(f"/evaluations/{done.id}/trials").json()]
    assert {t.status for t in trials} == {"success", "failure"}
    assert {t.attempts[0].cell for t in trials} == {"sim-0", "sim-1"}
    for sim in ("sim-0", "sim-1"):
        assert len(rest.nodes[sim].configured) >= 1


def test_pictures_are_served_as_png(rest):
    evaluation = rest.wait_for_end(rest.post(pictures=True).json()["id"])
    (trial,) = rest.get(f"/evaluations/{evaluation.id}/trials").json()
    assert trial["pictures"] == ["end-scene"]
    response = rest.get(f"/evaluations/{evaluation.id}/trials/0/pictures/end-scene")
    assert response.headers["content-type"] == "image/png"
    assert Image.open(io.BytesIO(response.content)).size == (4, 2)


def hold_all(rest):
    sims = [rest.nodes["sim-0"], rest.nodes["sim-1"]]
    for sim in sims:
        sim.hold.set()
    return sims


def statuses(rest, evaluation):
    return [trial.status for trial in rest.plane.queries.trials(evaluation)]


def when_followed(rest, action):
    """Do something as soon as somebody follows an evaluation."""

    def act():
        rest.wait_until(lambda: len(rest.plane.subscriptions) == 1)
        action()

    thread = threading.Thread(target=act)
    thread.start()
    return thread


def test_events_tell_each_trial_and_the_end(rest):
    sims = hold_all(rest)
    evaluation = rest.post(trials=3).json()["id"]
    rest.wait_until(lambda: statuses(rest, evaluation).count("running") == 2)
    thread = when_followed(rest, lambda: [sim.hold.clear() for sim in sims])
    response = rest.get(f"/evaluations/{evaluation}/events")
    thread.join()
    assert response.headers["content-type"].startswith("text/event-stream")
    parsed = events_of(response)
    assert {event.name for event in parsed[:-1]} == {"progress"}
    assert parsed[-1].name == "end"
    events = [ProgressEvent.model_validate_json(event.data) for event in parsed]
    assert (events[0].trial, events[0].evaluation.trials_done) == (None, 0)
    done = [event.evaluation.trials_done for event in events]
    assert done == sorted(done)
    assert {event.trial.id for event in events if event.trial is not None} == {0, 1, 2}
    assert (events[-1].evaluation.status, done[-1]) == ("done", 3)
    assert len(rest.plane.subscriptions) == 0


def test_events_of_an_ended_evaluation_end_at_once(rest):
    evaluation = rest.wait_for_end(rest.post().json()["id"])
    events = events_of(rest.get(f"/evaluations/{evaluation.id}/events"))
    assert [event.name for event in events] == ["progress", "end"]
    assert ProgressEvent.model_validate_json(events[1].data).evaluation == evaluation


def test_quiet_stream_beats_and_a_closing_one_ends_without_an_end(rest):
    hold_all(rest)
    evaluation = rest.post().json()["id"]
    rest.wait_until(lambda: statuses(rest, evaluation) == ["running"])

    async def read():
        pieces = []
        async for piece in sse.follow(rest.plane, evaluation, heartbeat_s=0.01):
            pieces.append(piece)
            if len(pieces) == 4:
                rest.plane.subscriptions.close()
        return pieces

    first, *rest_of_it = asyncio.run(asyncio.wait_for(read(), WAIT_S))
    assert first.startswith("event: progress\ndata: {")
    assert set(rest_of_it) == {": heartbeat\n\n"}
    assert len(rest.plane.subscriptions) == 0


def test_reader_that_leaves_is_forgotten(rest):
    hold_all(rest)
    evaluation = rest.post().json()["id"]

    async def read():
        stream = sse.follow(rest.plane, evaluation)
        await anext(stream)
        assert len(rest.plane.subscriptions) == 1
        await stream.aclose()

    asyncio.run(read())
    assert len(rest.plane.subscriptions) == 0


def test_cancel_keeps_what_has_ended(rest):
    sims = hold_all(rest)
    evaluation = rest.post(trials=50).json()["id"]
    rest.wait_until(lambda: statuses(rest, evaluation).count("running") == 2)
    assert rest.request("DELETE", f"{PREFIX}/evaluations/{evaluation}").status_code == 202
    assert rest.wait_for_end(evaluation).status == "cancelled"
    assert set(statuses(rest, evaluation)) == {"cancelled"}
    rest.wait_until(lambda: all(sim.aborted for sim in sims))
    again = rest.request("DELETE", f"{PREFIX}/evaluations/{evaluation}")
    assert (again.status_code, again.json()["status"]) == (202, "cancelled")


def test_problem_of_a_node_reaches_the_trial(rest):
    rest.nodes["policy"].problem = Problem(
        code="E-X", happened="no weights", expected="a file", action="get it"
    )
    evaluation = rest.wait_for_end(rest.post().json()["id"])
    (trial,) = rest.plane.queries.trials(evaluation.id)
    reason = "node_problem: policy policy: no weights; a file; get it"
    assert (trial.status, trial.reason) == ("aborted", reason)
    assert [attempt.outcome for attempt in trial.attempts] == ["aborted", "aborted"]
    assert evaluation.cells[0].success_rate == 0.0


def test_restart_goes_on_where_the_first_process_stopped(tmp_path):
    url = database_url(tmp_path)
    with running_plane(usual_nodes(), url=url) as first:
        first.nodes["sim-0"].judge = stop_after(first.nodes["sim-0"], trials=2)
        evaluation = first.post(trials=5).json()["id"]
        first.wait_until(lambda: statuses(first, evaluation)[:3] == ["success"] * 2 + ["running"])
        before = first.plane.queries.trials(evaluation)
    with running_plane(usual_nodes(), url=url) as second:
        assert second.wait_for_end(evaluation).trials_done == 5
        after = second.plane.queries.trials(evaluation)
        assert after[:2] == before[:2]
        assert [len(trial.attempts) for trial in after] == [1, 1, 2, 1, 1]
        assert len(second.nodes["sim-0"].configured) == 3


def stop_after(sim, *, trials):
    """A judge that lets so many trials end and holds the next one."""
    judged = []

    def judge(configure):
        judged.append(configure)
        if len(judged) == trials:
            sim.hold.set()
        return make_result(seed=configure.seed)

    return judge


def test_evaluation_waits_for_a_missing_node_and_says_so(rest):
    evaluation = rest.post().json()["id"]
    rest.wait_for_end(evaluation)
    hold_all(rest)
    evaluation = rest.post(trials=2, robots=["panda"]).json()["id"]
    rest.wait_until(lambda: statuses(rest, evaluation) == ["running"] * 2)
    rest.host.inbox.put_event(NodeDown("retarget", "retarget-panda"))
    rest.wait_until(lambda: statuses(rest, evaluation) == ["pending"] * 2)
    rest.wait_until(
        lambda: rest.plane.evaluation(evaluation).waiting_for == ["retarget retarget-panda"]
    )
    assert not next(r for r in rest.get("/robots").json() if r["name"] == "panda")["available"]
    rest.host.inbox.put_event(NodeUp("retarget", "retarget-panda"))
    rest.wait_until(lambda: statuses(rest, evaluation) == ["running"] * 2)
    (attempt, _) = rest.plane.queries.trial(evaluation, 0).attempts
    assert attempt.reason == "node_left: retarget retarget-panda left (process died or link lost)"


def test_catalog_and_nodes_are_listed(rest):
    robots = [RobotInfo.model_validate(robot) for robot in rest.get("/robots").json()]
    assert {robot.name: robot.available for robot in robots} == {
        "abstract": True,
        "panda": True,
        "spot": False,
    }
    assert [task["name"] for task in rest.get("/tasks").json()] == ["lid"]
    policies = [PolicyInfo.model_validate(policy) for policy in rest.get("/policies").json()]
    assert [(p.name, p.nodes) for p in policies] == [("expert", ["policy"]), ("random", ["policy"])]
    rest.wait_until(lambda: all(s["metrics"] for s in rest.get("/services").json()))
    services = [ServiceInfo.model_validate(service) for service in rest.get("/services").json()]
    assert [(s.kind, s.node) for s in services] == [
        ("control", "control"),
        ("gripper", "gripper"),
        ("policy", "policy"),
        ("retarget", "retarget-abstract"),
        ("retarget", "retarget-panda"),
        ("sim", "sim-0"),
        ("sim", "sim-1"),
    ]
    assert all(s.alive and s.code_version for s in services)


def test_schema_of_the_api_is_served(rest):
    schema = rest.get("/openapi.json").json()
    assert f"{PREFIX}/evaluations" in schema["paths"]
