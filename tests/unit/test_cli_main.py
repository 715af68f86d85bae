"""The command line without processes: parsing, verbs against a fake control plane, errors."""

from __future__ import annotations

import json
import subprocess
import sys

import httpx
import pytest

from client import main as cli
from client.api import LegatoClient
from client.commands import Demo, Eval, TopicEcho, Up
from client.errors import ControlUnreachable, RestError, UnknownNames
from client.failures import exit_code_of, format_error
from client.request import Known, build_request, check_names
from common.api import PolicyInfo, ProblemDetails, ProgressEvent, RobotInfo, TaskInfo
from common.errors import InvalidValue, UnknownName
from tests.client_samples import (
    make_cell_info,
    make_evaluation,
    make_request,
    make_service,
    make_trial,
)


@pytest.fixture
def run(capsys):
    """Run a command line; give exit code, standard output and standard error."""

    def call(*arguments: str) -> tuple[int, str, str]:
        code = cli.run(arguments)
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call


@pytest.fixture
def control(monkeypatch):
    """A control plane for every client that is opened; returns the calls it saw."""
    calls = []
    event = ProgressEvent(evaluation=make_evaluation(), trial=make_trial())
    stream = f"event: progress\ndata: {event.model_dump_json()}\n\nevent: end\ndata: {{}}\n\n"
    robots = [
        RobotInfo(name="abstract", title="Abstract", degrees_of_freedom=6, available=True),
        RobotInfo(name="panda", title="Panda", degrees_of_freedom=7, available=True),
        RobotInfo(name="spot", title="Spot", degrees_of_freedom=7, available=False),
    ]
    answers = {
        ("GET", "/readyz"): {},
        ("GET", "/api/v1/robots"): robots,
        ("GET", "/api/v1/tasks"): [TaskInfo(name="lid", title="Lid", time_limit_s=20)],
        ("GET", "/api/v1/policies"): [PolicyInfo(name="expert", nodes=["policy"])],
        ("GET", "/api/v1/services"): [make_service("sim", "sim-0")],
        ("GET", "/api/v1/cells"): [make_cell_info()],
        ("POST", "/api/v1/stop"): [make_cell_info(stopped=True)],
        ("POST", "/api/v1/reset"): [make_cell_info()],
        ("POST", "/api/v1/evaluations"): make_evaluation(),
        ("GET", "/api/v1/evaluations/e-1"): make_evaluation(),
        ("DELETE", "/api/v1/evaluations/e-1"): make_evaluation(),
        ("GET", "/api/v1/evaluations/e-1/trials"): [make_trial(pictures=["end-scene"])],
        ("GET", "/api/v1/evaluations/e-1/trials/0/pictures/end-scene"): b"png",
        ("GET", "/api/v1/evaluations/e-1/events"): stream.encode(),
    }

    def handler(request: httpx.Request) -> httpx.Response:
        calls.append((request.method, request.url.path, request.read()))
        answer = answers[request.method, request.url.path]
        if callable(answer):
            answer = answer()
        if isinstance(answer, bytes):
            return httpx.Response(200, content=answer)
        if isinstance(answer, list):
            return httpx.Response(200, json=[item.model_dump(mode="json") for item in answer])
        return httpx.Response(
            200, json=answer if isinstance(answer, dict) else answer.model_dump(mode="json")
        )

    def open_client(url: str = "http://test") -> LegatoClient:
        return LegatoClient(url, transport=httpx.MockTransport(handler))

    for module in ("evaluate", "deploy", "safety"):
        monkeypatch.setattr(f"client.verbs.{module}.LegatoClient", open_client)
    handler.answers, handler.calls = answers, calls
    return handler


def test_version(run):
    assert run("--version") == (0, "legato 0.1.0\n", "")


def test_help_lists_every_verb(run):
    code, out, _ = run("--help")
    assert code == 0
    assert all(f"  {' '.join(words)}" in out for words in cli.VERBS)
    assert run() == (0, out, "")


def test_help_of_a_family_lists_its_verbs(run):
    code, out, _ = run("topic")
    assert code == 0
    assert "topic echo" in out
    assert "status" not in out


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("evl",), 'E-UNKNOWN-NAME  no command "evl"   did you mean: eval'),
        (("topic", "ehco"), 'E-UNKNOWN-NAME  no command topic "ehco" did you mean: echo'),
        (("eval", "--trails", "3"), "E-USAGE  no option --trails; did you mean: --trials; run: "),
        (("eval", "--trials", "x"), "E-USAGE  --trials: 'x' is not a whole number; "),
        (("eval", "--trials"), "E-USAGE  Missing value for argument '--trials'"),
        (("eval", "--mode", "slow"), "E-USAGE  invalid choice 'slow' for argument '--mode'"),
        (("status", "extra"), "E-USAGE  Unrecognized options: extra"),
        (("topic", "echo"), "E-USAGE  missing: STR Topic"),
        (("eval", "--trials", "0"), "E-INVALID-VALUE  --trials is 0; expected "),
        (("eval", "--robot", "a b"), "E-INVALID-VALUE  --robot is 'a b'; expected "),
        (("eval", "--action-latency-ms", "2000"), "E-INVALID-VALUE  --action-latency-ms is 2.0"),
        (("up", "--port", "70000"), "E-INVALID-VALUE  --port is 70000; expected "),
        (("up", "--cells", "0"), "E-INVALID-VALUE  --cells is 0; expected "),
        (("demo", "--cells", "0"), "E-INVALID-VALUE  --cells is 0; expected "),
        (("topic", "echo", "nothing"), 'E-UNKNOWN-NAME  no topic "nothing"'),
        (("topic", "hz", "robot/state", "--duration-s", "0"), "E-INVALID-VALUE  --duration-s"),
        (("topic", "echo", "robot/state", "--cell", "a/b"), "E-INVALID-VALUE  --cell is 'a/b'"),
    ],
)
def test_wrong_use_is_one_line_and_exit_code_2(run, arguments, line):
    code, out, err = run(*arguments)
    assert (code, out) == (2, "")
    assert err.startswith(line)
    assert err.count("\n") == 1


def test_no_control_plane_is_exit_code_1(run):
    code, out, err = run("status", "--url", "http://127.0.0.1:1")
    assert (code, out) == (1, "")
    assert err.startswith("E-CONTROL  no control plane at http://127.0.0.1:1 (connection refused)")
    assert err.endswith("run: legato up\n")


def test_debug_shows_the_traceback(run):
    _, _, err = run("status", "--url", "http://127.0.0.1:1", "--debug")
    assert "Traceback" in err


def test_eval_prints_a_table_and_progress(run, control):
    code, out, err = run("eval", "--trials", "2")
    assert code == 0
    assert out.splitlines()[2].startswith("lid   abstract  expert  1/2")
    assert "lid panda expert  trial 0  success" in err
    (body,) = [json.loads(body) for method, _, body in control.calls if method == "POST"]
    assert body["robots"] == ["abstract", "panda"]
    assert body["policies"] == ["expert"]
    assert body["trials"] == 2


def test_eval_json_is_exactly_one_object(run, control):
    code, out, _ = run("eval", "--json")
    assert code == 0
    assert json.loads(out)["evaluation"] == "e-1"


def test_eval_writes_a_report(run, control, tmp_path):
    code, _, err = run("eval", "--report", str(tmp_path / "r.html"))
    assert code == 0
    assert f"report: {tmp_path / 'r.html'}" in err
    assert "data:image/png" in (tmp_path / "r.html").read_text()


def test_report_of_an_earlier_evaluation(run, control, tmp_path):
    code, out, _ = run("report", "e-1", "--out", str(tmp_path / "r.html"))
    assert (code, out) == (0, f"{tmp_path / 'r.html'}\n")
    assert (tmp_path / "r.html").exists()


def test_eval_lists_every_wrong_name(run, control):
    code, out, err = run("eval", "--task", "lidd", "--robot", "pnda", "--robot", "abstract")
    assert (code, out) == (2, "")
    first, second = err.splitlines()
    assert first == 'E-UNKNOWN-NAME  no task "lidd"     did you mean: lid         (lid)'
    assert second.startswith('E-UNKNOWN-NAME  no robot "pnda"    did you mean: panda')
    assert not any(method == "POST" for method, _, _ in control.calls)


def test_eval_names_a_robot_without_retargeter(run, control):
    code, _, err = run("eval", "--robot", "spot")
    assert code == 1
    assert err.startswith("E-NOT-READY  a retargeter for spot is not running; running: sim/sim-0")


def test_eval_needs_a_policy_service(run, control):
    control.answers["GET", "/api/v1/policies"] = []
    code, _, err = run("eval")
    assert code == 1
    assert "a policy service is not running" in err


def test_ctrl_c_cancels_and_shows_what_is_done(run, control):
    def interrupt():
        raise KeyboardInterrupt

    control.answers["GET", "/api/v1/evaluations/e-1/events"] = interrupt
    code, out, _ = run("eval", "--json")
    assert code == 130
    assert json.loads(out)["evaluation"] == "e-1"
    assert "DELETE" in [method for method, _, _ in control.calls]


def test_status(run, control):
    code, out, _ = run("status")
    assert code == 0
    assert "sim-0" in out
    assert out.endswith("ready\n")
    code, out, _ = run("status", "--json")
    assert json.loads(out)["ready"] is True
    assert json.loads(out)["services"][0]["node"] == "sim-0"

    assert json.loads(out)["cells"][0]["status"] == "stopped"


def test_stop_and_reset(run, control):
    code, out, _ = run("stop", "--cell", "sim-0", "--reason", "too near")
    assert code == 0
    assert "emergency stop of sim-0 by rest (too near) (E-EMERGENCY-STOP)" in out
    code, out, _ = run("reset", "--json")
    assert code == 0
    assert json.loads(out)["cells"][0]["emergency_stop"] is False
    sent = [(path, json.loads(body)) for method, path, body in control.calls if method == "POST"]
    assert sent == [
        ("/api/v1/stop", {"cells": ["sim-0"], "reason": "too near"}),
        ("/api/v1/reset", {"cells": None}),
    ]


def test_down_without_a_deployment_is_fine(run, tmp_path):
    code, out, _ = run("down", "--data", str(tmp_path))
    assert (code, out) == (0, f"nothing runs in {tmp_path}\n")


def test_repeated_options_replace_the_default():
    command = cli.parse(Eval, ["--robot", "panda", "--robot", "spot"], program="legato eval")
    request = build_request(command, pictures=False)
    assert request.robots == ["panda", "spot"]
    assert (request.tasks, request.policy_names) == (["lid"], ["expert"])


def test_options_reach_the_request():
    command = cli.parse(
        Eval,
        ["--mode=realtime", "--camera=c", "--full-grid", "--action-latency-ms=50", "--seed=9"],
        program="legato eval",
    )
    request = build_request(command, pictures=True)
    assert (request.mode, request.camera, request.full_grid) == ("realtime", "c", True)
    assert (request.action_latency_s, request.seed, request.pictures) == (0.05, 9, True)


def test_a_name_twice_is_refused():
    with pytest.raises(InvalidValue, match="names something twice"):
        build_request(Eval(robot=("panda", "panda")), pictures=False)


def test_check_names_accepts_what_exists():
    known = Known(tasks=["lid"], robots=["abstract", "panda"], policies=["expert"])
    check_names(make_request(), known)
    with pytest.raises(UnknownNames) as caught:
        check_names(make_request(tasks=["a"], policies=["b"]), known)
    assert [error.kind for error in caught.value.errors] == ["task", "policy"]


def test_other_verbs_parse():
    assert cli.parse(Demo, ["--trials", "1"], program="legato demo") == Demo(trials=1)
    up = cli.parse(Up, ["--robot", "spot", "--foreground"], program="legato up")
    assert up == Up(robot=("spot",), foreground=True)
    echo = cli.parse(TopicEcho, ["truth", "--count", "3"], program="legato topic echo")
    assert echo == TopicEcho(topic="truth", count=3)


def refusal(status: int, **fields) -> RestError:
    values = {"type": "x", "title": "x", "status": status, "detail": "d", "code": "E-X"}
    return RestError(ProblemDetails(**values, expected="e", action="a", **fields))


def test_exit_codes():
    assert exit_code_of(UnknownName("task", "x", [])) == 2
    assert exit_code_of(ControlUnreachable("u", "p")) == 1
    assert exit_code_of(refusal(422)) == 2
    assert exit_code_of(refusal(503)) == 1


def test_a_refusal_shows_its_own_code_and_every_field():
    error = refusal(422, errors=[{"field": "trials", "happened": "trials is 0"}])
    assert format_error(error) == "E-X  d; e; a\n  trials: trials is 0"


SERIALISING = """
import os, signal
from pydantic import BaseModel, field_serializer
from client import main

class Note(BaseModel):
    text: str = ""

    @field_serializer("text")
    def write(self, text: str) -> str:
        os.kill(os.getpid(), signal.SIGTERM)
        return text

main.run = lambda arguments: Note().model_dump_json()
main.main([])
"""


def test_an_interrupt_that_an_extension_wraps_up_is_one():
    done = subprocess.run(
        [sys.executable, "-c", SERIALISING], capture_output=True, text=True, timeout=120
    )
    assert (done.returncode, done.stderr) == (130, "")
