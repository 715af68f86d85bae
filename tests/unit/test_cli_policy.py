"""`legato policy` against a fake control plane, and folders as policies of `legato eval`."""

from __future__ import annotations

import json
from pathlib import Path

import httpx
import pytest

from client import main as cli
from client.api import LegatoClient
from client.commands import Eval
from client.offline import check_request_here, load_library
from client.verbs.evaluate import name_folders
from common.api import PolicyInfo
from common.errors import InvalidValue, UntrainedTask
from services.policy.serving import library as library_module
from tests.checkpoints import write_checkpoint
from tests.client_samples import make_request
from tests.control_nodes import make_checkpoint


@pytest.fixture
def control(monkeypatch) -> list[tuple[str, str, dict[str, object]]]:
    """A control plane for every client that is opened; returns the calls it saw."""
    calls = []
    learned = PolicyInfo(
        name="lid-1", nodes=["policy"], checkpoints={"policy": make_checkpoint("runs/one")}
    )
    expert = PolicyInfo(name="expert", nodes=["policy"])

    def handler(request: httpx.Request) -> httpx.Response:
        body = json.loads(request.read() or b"{}")
        calls.append((request.method, request.url.path, body))
        if request.method == "PUT":
            return httpx.Response(200, text=learned.model_dump_json())
        return httpx.Response(200, json=[each.model_dump() for each in (expert, learned)])

    real = LegatoClient.__init__

    def init(self, base_url="http://test", **options) -> None:
        real(self, base_url, **options | {"transport": httpx.MockTransport(handler)})

    monkeypatch.setattr(LegatoClient, "__init__", init)
    return calls


def test_policies_are_listed(control, capsys):
    assert cli.run(["policy", "list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["policy", "node", "tasks", "method", "runs", "on", "hash", "folder"]
    assert "built in" in lines[2]
    assert "lid-1" in lines[3]
    assert make_checkpoint("runs/one").sha256[:12] in lines[3]
    assert cli.run(["policy", "list", "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert [each["name"] for each in shown["policies"]] == ["expert", "lid-1"]


def test_a_folder_of_this_machine_is_sent_whole_another_as_it_is(control, capsys, tmp_path: Path):
    (tmp_path / "one").mkdir()
    for given, sent in (
        (str(tmp_path / "one"), str(tmp_path / "one")),
        ("on/the/policy/host", "on/the/policy/host"),
    ):
        assert cli.run(["policy", "load", "lid-1", given]) == 0
        assert control[-1] == ("PUT", "/api/v1/policies/lid-1", {"folder": sent, "node": None})
    assert "runs/one" in capsys.readouterr().out
    assert cli.run(["policy", "load", "lid-1", "one", "--node", "policy", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["name"] == "lid-1"
    assert control[-1][2]["node"] == "policy"


def test_a_name_that_cannot_be_one_is_refused_here(control, capsys):
    assert cli.run(["policy", "load", "lid/1", "one"]) == 2
    assert "E-INVALID-VALUE" in capsys.readouterr().err
    assert control == []


def test_eval_takes_folders_in_process_only():
    named, folders = name_folders(Eval(policy=("expert", "runs/lid-1/"), in_process=True))
    assert named.policy == ("expert", "lid-1")
    assert folders == {"lid-1": Path("runs/lid-1").absolute()}
    with pytest.raises(InvalidValue, match="legato policy load"):
        name_folders(Eval(policy=("runs/lid-1",)))
    with pytest.raises(InvalidValue, match="different names"):
        name_folders(Eval(policy=("a/lid-1", "b/lid-1"), in_process=True))


def test_a_checkpoint_may_not_take_the_name_of_an_expert(tmp_path: Path):
    with pytest.raises(InvalidValue, match="expert"):
        check_request_here(make_request(), checkpoints={"expert": tmp_path})


def test_a_task_it_was_not_trained_for_is_refused_before_anything_runs(tmp_path: Path):
    folder = write_checkpoint(tmp_path / "small", tasks=("lid",))
    request = make_request(tasks=["lid", "cup"], policies=["expert", "small"])
    check_request_here(request, checkpoints={"small": folder})
    with pytest.raises(UntrainedTask, match="cup"):
        load_library(request, checkpoints={"small": folder})


def test_a_shipped_policy_is_known_by_its_name(tmp_path: Path, monkeypatch):
    folder = write_checkpoint(tmp_path / "small")
    monkeypatch.setattr(library_module, "find_shipped", lambda: {"shipped": folder})
    request = make_request(policies=["shipped"])
    check_request_here(request)
    assert load_library(request).names() == ["shipped"]
