"""Emergency stop and reset over REST, down to the cells' owners."""

from __future__ import annotations

import pytest

from common.api import PREFIX, CellInfo
from common.messages import NodeDown, NodeUp
from services.control import cells
from tests.control_nodes import make_safety_state, usual_nodes
from tests.control_rest import running_plane


@pytest.fixture
def rest():
    with running_plane(usual_nodes(cells=2)) as running:
        yield running


def post(rest, path, **body):
    return rest.request("POST", PREFIX + path, json=body)


def stopped(response) -> dict[str, bool]:
    assert response.status_code == 200, response.text
    infos = [CellInfo.model_validate(each) for each in response.json()]
    return {info.cell: info.emergency_stop for info in infos}


def statuses(rest, evaluation):
    return [trial.status for trial in rest.plane.queries.trials(evaluation)]


def test_cells_are_listed_before_their_guards_have_spoken(rest):
    assert [(cell["cell"], cell["status"]) for cell in rest.get("/cells").json()] == [
        ("sim-0", None),
        ("sim-1", None),
    ]


def test_stop_reaches_every_cell_and_reset_releases_them(rest):
    assert stopped(post(rest, "/stop", reason="smoke")) == {"sim-0": True, "sim-1": True}
    (first, _) = rest.get("/cells").json()
    assert first["fault"]["code"] == "E-EMERGENCY-STOP"
    assert first["fault"]["happened"] == "emergency stop of sim-0 by rest (smoke)"
    assert rest.nodes["sim-0"].stopped_by is not None
    assert stopped(post(rest, "/reset", cells=["sim-1"])) == {"sim-1": False}
    assert stopped(rest.get("/cells")) == {"sim-0": True, "sim-1": False}


def test_the_running_trial_is_aborted_for_good_and_the_others_wait(rest):
    for name in ("sim-0", "sim-1"):
        rest.nodes[name].hold.set()
    evaluation = rest.post(trials=3).json()["id"]
    rest.wait_until(lambda: statuses(rest, evaluation).count("running") == 2)
    post(rest, "/stop")
    rest.wait_until(lambda: statuses(rest, evaluation) == ["aborted", "aborted", "pending"])
    trial = rest.plane.queries.trials(evaluation)[0]
    assert trial.reason.startswith("emergency_stop: emergency stop of sim-0 by rest")
    assert trial.reason.endswith("(E-EMERGENCY-STOP)")
    assert [attempt.outcome for attempt in trial.attempts] == ["aborted"]
    waiting = ["reset of sim-0", "reset of sim-1"]
    rest.wait_until(lambda: rest.plane.evaluation(evaluation).waiting_for == waiting)
    for name in ("sim-0", "sim-1"):
        rest.nodes[name].hold.clear()
    post(rest, "/reset")
    rest.wait_for_end(evaluation)
    assert statuses(rest, evaluation) == ["aborted", "aborted", "success"]


def test_a_stop_from_elsewhere_ends_the_trial_too(rest):
    rest.nodes["sim-0"].hold.set()
    rest.nodes["sim-1"].hold.set()
    evaluation = rest.post().json()["id"]
    rest.wait_until(lambda: statuses(rest, evaluation) == ["running"])
    button = make_safety_state("sim-0").model_copy(update={"emergency_stop": True})
    fault = {"code": "E-EMERGENCY-STOP", "happened": "button", "expected": "e", "action": "a"}
    state = type(button).model_validate(
        {**button.model_dump(), "header": button.header, "fault": fault}
    )
    rest.host.inbox.put_event(state)
    rest.wait_until(lambda: statuses(rest, evaluation) == ["aborted"])
    assert (
        rest.plane.queries.trials(evaluation)[0].reason
        == "emergency_stop: button (E-EMERGENCY-STOP)"
    )


def test_a_cell_that_does_not_confirm_is_told_again_until_it_does(rest, monkeypatch):
    monkeypatch.setattr(cells, "ANSWER_TIMEOUT_S", 0.3)
    rest.nodes["sim-1"].deaf.set()
    response = post(rest, "/stop")
    assert (response.status_code, response.json()["code"]) == (504, "E-NODE-TIMEOUT")
    assert "sim-1 sent no confirmation of the emergency stop" in response.json()["detail"]
    rest.nodes["sim-1"].deaf.clear()
    rest.wait_until(lambda: stopped(rest.get("/cells")) == {"sim-0": True, "sim-1": True})


def test_a_cell_that_was_lost_is_stopped_again_when_it_is_back(rest):
    post(rest, "/stop", cells=["sim-0"])
    rest.nodes["sim-0"].stopped_by = None
    rest.host.inbox.put_event(NodeDown("sim", "sim-0"))
    rest.host.inbox.put_event(NodeUp("sim", "sim-0"))
    rest.wait_until(lambda: rest.nodes["sim-0"].stopped_by is not None)
    rest.wait_until(lambda: stopped(rest.get("/cells"))["sim-0"])


@pytest.mark.parametrize("path", ["/stop", "/reset"])
def test_what_is_not_a_cell_is_named(rest, path):
    response = post(rest, path, cells=["sim-9"])
    assert (response.status_code, response.json()["code"]) == (422, "E-UNKNOWN-NAME")
    assert post(rest, path, cells=[]).status_code == 422


def test_without_a_cell_there_is_nothing_to_stop():
    with running_plane([node for node in usual_nodes() if node.kind != "sim"]) as rest:
        response = post(rest, "/stop")
        assert (response.status_code, response.json()["code"]) == (503, "E-NOT-READY")
