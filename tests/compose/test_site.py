"""A site: other hosts reach the router, by certificate, and do only what their role may."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from client import main as cli
from client.api import LegatoClient
from client.certificates import create_authority
from client.deployment import find_free_ports
from common.api import EvaluationRequest, Trial
from common.bus import BusSettings, Credentials
from common.errors import RouterRefused, RouterUnreachable
from tests.compose.projects import Project, docker, gateway, started
from tests.compose.test_compose import alive, wait_until
from tests.deployments import wait_until_done
from tests.intruder import interfering

pytestmark = pytest.mark.compose

FILES = ("compose.yaml", "compose.site.yaml")
SERVICES = ("router", "control", "sim", "gripper", "retarget-abstract")
"""Without a policy of its own."""

HOSTS = {"policy-lab": "sim-*", "policy-elsewhere": "elsewhere-*"}
"""Policy hosts, and the cells that their certificates are for. The site's are `sim-` and more."""


@dataclass(frozen=True)
class Site:
    """A running site, its REST client, and copies of its certificates that the test can read."""

    project: Project
    client: LegatoClient
    router: str
    given: Path
    certs: Path
    lab: Project

    def settings(self, role: str) -> BusSettings:
        own = Credentials.from_folder(self.certs / role)
        return BusSettings("client", f"tls/{self.router}", "legato", own)

    def submit(self) -> str:
        wait_until(self.client.ready)
        request = EvaluationRequest(
            tasks=["lid"], robots=["abstract"], policy="legato-lid", trials=1, pictures=False
        )
        return self.client.submit(request).id

    def finish(self, evaluation: str) -> Trial:
        wait_until_done(self.client, evaluation, timeout_s=900.0)
        return self.client.trials(evaluation)[0]

    def evaluate(self) -> Trial:
        return self.finish(self.submit())

    def disturb(self, role: str) -> Trial:
        """A trial during which a role sends commands that do not fit."""
        viewer, source = self.settings("viewer"), "retarget-abstract"
        with interfering(viewer, self.settings(role), source=source) as answered:
            trial = self.evaluate()
        assert answered, endings(trial)
        return trial


def endings(trial: Trial) -> list[tuple[str, str]]:
    """How each attempt at a trial ended, and why."""
    return [(attempt.outcome, attempt.reason) for attempt in trial.attempts]


def give_to_containers(folder: Path) -> None:
    """As `sudo chown 10001` would, where the tests are not root."""
    command = "chown 10001 /given/*/key.pem /given/*/grant*.json /given/api_keys.json"
    mount = f"--volume={folder}:/given"
    docker("run", "--rm", "--user=0", mount, "--entrypoint=sh", "legato-router", "-c", command)


def legato(*arguments: str) -> str:
    done = subprocess.run(
        [sys.executable, "-m", "client.main", *arguments], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def make_host(name: str, *, router: str, certs: Path) -> Project:
    """A policy in a project of its own, which stands for another host."""
    env = {
        "ZENOH_ROUTER": f"tls/{router}",
        "LEGATO_CERTS": str(certs / name),
        "LEGATO_NODE": name,
    }
    return Project(files=("compose.policy.yaml",), env=env)


@pytest.fixture(scope="module")
def site(images, tmp_path_factory) -> Iterator[Site]:
    given, certs = tmp_path_factory.mktemp("site") / "given", tmp_path_factory.mktemp("copy") / "c"
    create_authority(given, hosts=[gateway()], days=1)
    for name, cells in HOSTS.items():
        legato("certs", "add", "policy", f"--name={name}", f"--cell={cells}", f"--out={given}")
    file = given / "api_keys.json"
    key = legato("keys", "create", "--name=test", "--role=operate", f"--file={file}")
    shutil.copytree(given, certs)
    give_to_containers(given)
    rest_port, router_port = find_free_ports(2)
    router = f"{gateway()}:{router_port}"
    env = {
        "LEGATO_PORT": str(rest_port),
        "LEGATO_ROUTER": router,
        "LEGATO_CERTS": str(given),
        "LEGATO_API_KEYS": str(given / "api_keys.json"),
    }
    project = Project(files=FILES, env=env)
    lab = make_host("policy-lab", router=router, certs=given)
    with (
        pytest.MonkeyPatch.context() as patch,
        started(project, *SERVICES),
        started(lab),
    ):
        patch.setenv("LEGATO_API_KEY", key)
        with LegatoClient(f"http://127.0.0.1:{rest_port}", timeout_s=60.0) as client:
            yield Site(project, client, router, given, certs, lab)


@pytest.fixture(scope="module")
def undisturbed(site) -> Trial:
    return site.evaluate()


def test_a_policy_on_another_host_is_evaluated(site, undisturbed):
    assert alive(site.client, "policy") == {"policy-lab"}
    ((outcome, reason),) = endings(undisturbed)
    assert outcome in ("success", "failure"), reason


def test_commands_of_the_policy_host_have_no_effect(site, undisturbed):
    trial = site.disturb("policy")
    assert endings(trial) == endings(undisturbed)
    assert trial.result.trace_sha256 == undisturbed.result.trace_sha256


def test_the_same_commands_of_a_retargeter_have(site):
    trial = site.disturb("retarget")
    assert trial.attempts[0].outcome == "aborted"
    assert "E-SHAPE" in trial.attempts[0].reason


def test_without_a_certificate_nobody_gets_in(site, capsys, tmp_path):
    measure = ["topic", "hz", "robot/state", "--duration-s=0.5"]
    assert cli.run([*measure, f"--endpoint=tcp/{site.router}"]) == 1
    assert capsys.readouterr().err.startswith(f"{RouterUnreachable.code} ")
    create_authority(tmp_path / "other", hosts=[], days=1)
    foreign = tmp_path / "other" / "viewer"
    shutil.copy(site.certs / "ca.pem", foreign)
    assert cli.run([*measure, f"--endpoint=tls/{site.router}", f"--certs={foreign}"]) == 2
    shutil.copy(tmp_path / "other" / "ca.pem", foreign)
    assert cli.run([*measure, f"--endpoint=tls/{site.router}", f"--certs={foreign}"]) == 1
    assert f"{RouterRefused.code} " in capsys.readouterr().err


def test_a_container_sees_its_own_key_and_cannot_change_it(site):
    for service, role in (("router", "router"), ("sim", "sim"), ("retarget-abstract", "retarget")):
        # The rights of the hosts are the router's to know.
        more = ["grants.json"] if role == "router" else []
        mounted = site.project.inside(service, "ls /certs").split()
        assert mounted == ["ca.pem", "cert.pem", *more, "key.pem"]
        own = (site.certs / role / "key.pem").read_text()
        assert site.project.inside(service, "cat /certs/key.pem") == own
        assert site.project.run("exec", "-T", service, "touch", "/certs/x").returncode != 0
    assert site.project.inside("control", "ls /run/secrets").split() == ["api_keys"]


def test_rest_is_for_this_machine_and_the_router_for_others(site):
    services = site.project.config()["services"]
    ports = {
        name: [port["host_ip"] for port in service["ports"]]
        for name, service in services.items()
        if "ports" in service
    }
    assert ports == {"control": ["127.0.0.1"], "router": [gateway()]}


def test_a_host_whose_certificate_is_for_other_cells_is_given_no_trial(site):
    with started(make_host("policy-elsewhere", router=site.router, certs=site.given)):
        site.lab.compose("stop")
        try:
            wait_until(lambda: alive(site.client, "policy") == {"policy-elsewhere"})
            evaluation = site.submit()
            wait_until(lambda: site.client.evaluation(evaluation).waiting_for != [])
            (wanted,) = site.client.evaluation(evaluation).waiting_for
            assert wanted.startswith("a cell in which")
        finally:
            site.lab.compose("start")
        # Nothing else was missing.
        ((outcome, reason),) = endings(site.finish(evaluation))[-1:]
    assert outcome in ("success", "failure"), reason


@pytest.mark.usefixtures("images")
@pytest.mark.parametrize("missing", ["LEGATO_CERTS", "LEGATO_ROUTER", "LEGATO_API_KEYS"])
def test_a_site_asks_for_what_it_needs(missing):
    env = {"LEGATO_CERTS": "certs", "LEGATO_ROUTER": "10.0.0.5:7447", "LEGATO_API_KEYS": "keys"}
    done = Project(files=FILES, env=env | {missing: ""}).run("config")
    assert done.returncode != 0
    assert missing in done.stderr
