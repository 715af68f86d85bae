"""`legato up --compose` beside a docker that writes down how it was called."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from client.commands import Down, Up
from client.containers import compose_down, compose_up
from client.verbs.deploy import down, up
from common.errors import InvalidValue, MissingProgram, UnknownName

NAMES = ("COMPOSE_PROFILES", "LEGATO_PORT", "LEGATO_ROUTER", "LEGATO_CHECKPOINTS", "LEGATO_LEASE_S")


@pytest.fixture
def docker(tmp_path, monkeypatch):
    """A folder with a compose.yaml and a docker; gives what docker was called with."""
    called, code = tmp_path / "called.json", tmp_path / "code"
    code.write_text("0")
    program = tmp_path / "docker"
    program.write_text(
        f"#!{sys.executable}\n"
        "import json, os, sys\n"
        f"names = {NAMES}\n"
        "said = [sys.argv[1:], {n: os.environ[n] for n in names if n in os.environ}]\n"
        f"open({str(called)!r}, 'w').write(json.dumps(said))\n"
        f"sys.exit(int(open({str(code)!r}).read()))\n"
    )
    program.chmod(0o755)
    (tmp_path / "compose.yaml").write_text("")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", str(tmp_path))
    for name in NAMES:
        monkeypatch.delenv(name, raising=False)
    return called


def read(called: Path) -> tuple[list[str], dict[str, str]]:
    arguments, environment = json.loads(called.read_text())
    return arguments, environment


def test_without_options_compose_decides(docker):
    assert up(Up(compose=True)) == 0
    assert read(docker) == (["compose", "up", "--wait", "--scale", "sim=1"], {})


def test_options_become_what_compose_knows(docker, tmp_path, monkeypatch):
    monkeypatch.setenv("COMPOSE_PROFILES", "observe")
    (tmp_path / "mine").mkdir()
    command = Up(
        compose=True,
        robot=("panda", "spot", "gr1"),
        cells=3,
        port=8100,
        router_port=7500,
        checkpoints=Path("mine"),
        lease_s=5,
    )
    assert up(command) == 0
    arguments, environment = read(docker)
    assert arguments[-1] == "sim=3"
    assert environment == {
        "COMPOSE_PROFILES": "observe,spot,gr1",
        "LEGATO_PORT": "8100",
        "LEGATO_ROUTER": "127.0.0.1:7500",
        "LEGATO_CHECKPOINTS": str(tmp_path / "mine"),
        "LEGATO_LEASE_S": "5",
    }


def test_down_stops_every_profile(docker):
    assert down(Down(compose=True)) == 0
    assert read(docker)[0] == ["compose", "--profile=*", "down"]


def test_the_exit_code_is_that_of_compose(docker, tmp_path):
    (tmp_path / "code").write_text("17")
    assert compose_up(Up(compose=True)) == 17
    assert compose_down() == 17


@pytest.mark.parametrize(
    "command",
    [
        Up(compose=True, data=Path("elsewhere")),
        Up(compose=True, foreground=True),
        Up(compose=True, namespace="other"),
        Up(compose=True, metrics_port=9000),
    ],
    ids=["data", "foreground", "namespace", "metrics"],
)
def test_what_containers_do_not_have_is_refused(docker, command):
    with pytest.raises(InvalidValue):
        up(command)
    assert not docker.exists()


def test_an_unknown_robot(docker):
    with pytest.raises(UnknownName, match="panda"):
        up(Up(compose=True, robot=("pandaa",)))


def test_a_folder_without_compose_yaml(docker, tmp_path):
    (tmp_path / "compose.yaml").unlink()
    with pytest.raises(InvalidValue, match=r"compose\.yaml"):
        compose_down()


def test_a_machine_without_docker(docker, tmp_path):
    (tmp_path / "docker").unlink()
    with pytest.raises(MissingProgram, match=r"Compose 2\.24"):
        compose_up(Up(compose=True))
