"""The whole system over an encrypted bus with access control, every process real."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from client import main as cli
from client.api import LegatoClient
from client.deployment import Deployment
from common.api import EvaluationRequest, Trial
from common.bus import BusSettings, Credentials
from common.errors import RouterUnreachable
from tests.certificates import EXPIRED, make_certificates
from tests.deployments import running, wait_for_running_trial, wait_until_done
from tests.intruder import interfering

pytestmark = pytest.mark.processes


@dataclass(frozen=True)
class Secure:
    """A running deployment and the certificates of its roles."""

    deployment: Deployment
    client: LegatoClient
    certs: Path

    def evaluate(self, policy: str) -> Trial:
        evaluation = self.submit(policy)
        wait_until_done(self.client, evaluation, timeout_s=600.0)
        return self.client.trials(evaluation)[0]

    def submit(self, policy: str = "expert") -> str:
        request = EvaluationRequest(tasks=["lid"], robots=["abstract"], policy=policy, trials=1)
        return self.client.submit(request).id

    def settings(self, role: str) -> BusSettings:
        own = Credentials.from_folder(self.certs / role)
        return BusSettings("client", self.deployment.endpoint, self.deployment.namespace, own)

    def disturb(self, role: str) -> Trial:
        """A trial of the expert during which a role sends commands that do not fit."""
        source = "retarget-abstract"
        with interfering(self.settings("viewer"), self.settings(role), source=source) as answered:
            trial = self.evaluate("expert")
        assert answered, endings(trial)
        return trial


def endings(trial: Trial) -> list[tuple[str, str]]:
    """How each attempt at a trial ended, and why."""
    return [(attempt.outcome, attempt.reason) for attempt in trial.attempts]


@pytest.fixture(scope="module")
def certs(tmp_path_factory) -> Path:
    return make_certificates(tmp_path_factory.mktemp("secure") / "certs")


@pytest.fixture(scope="module")
def secure(certs, tmp_path_factory) -> Iterator[Secure]:
    folder = tmp_path_factory.mktemp("runs")
    with running(folder, robots=("abstract",), certs=certs) as (deployment, _, client):
        yield Secure(deployment, client, certs)


@pytest.fixture(scope="module")
def undisturbed(secure) -> Trial:
    return secure.evaluate("expert")


def test_the_expert_and_the_shipped_policy_are_evaluated(secure, undisturbed):
    assert [attempt.outcome for attempt in undisturbed.attempts] == ["success"]
    learned = secure.evaluate("legato-lid")
    assert learned.status in ("success", "failure")
    assert learned.result.ticks > 0


def test_commands_of_a_policy_host_have_no_effect(secure, undisturbed):
    trial = secure.disturb("policy")
    assert endings(trial) == endings(undisturbed)
    assert trial.result.trace_sha256 == undisturbed.result.trace_sha256


def test_the_same_commands_of_a_retargeter_have(secure):
    trial = secure.disturb("retarget")
    assert trial.attempts[0].outcome == "aborted"
    assert "E-SHAPE" in trial.attempts[0].reason


def test_a_viewer_sees_the_bus_and_nobody_else_does(secure, capsys):
    where = [f"--endpoint={secure.deployment.endpoint}"]
    where += [f"--namespace={secure.deployment.namespace}"]
    evaluation = secure.submit()
    wait_for_running_trial(secure.client, evaluation)
    echo = ["topic", "echo", "robot/state", "--count=1", *where]
    assert cli.run([*echo, f"--certs={secure.certs / 'viewer'}"]) == 0
    assert '"cell/sim-0/robot/state"' in capsys.readouterr().out
    measure = ["topic", "hz", "robot/state", "--duration-s=0.5", *where]
    assert cli.run([*measure, f"--certs={secure.certs / 'policy'}"]) == 0
    assert capsys.readouterr().out == "nothing on robot/state in 0.5 s\n"
    assert cli.run(echo) == 2
    assert "E-INVALID-VALUE  --certs" in capsys.readouterr().err
    plain = secure.deployment.endpoint.replace("tls/", "tcp/")
    assert cli.run(["topic", "hz", "robot/state", f"--endpoint={plain}"]) == 1
    assert RouterUnreachable.code in capsys.readouterr().err
    wait_until_done(secure.client, evaluation, timeout_s=600.0)


@pytest.mark.parametrize(
    ("module", "folder", "problem"),
    [("services.gripper", EXPIRED, "expired"), ("services.router", "none", "No such file")],
)
def test_a_bad_certificate_ends_a_process_at_once(certs, module, folder, problem):
    done = subprocess.run(
        [sys.executable, "-m", module, f"--certs={certs / folder}"],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]
    assert last.startswith("E-CERTIFICATE")
    assert problem in last


def test_certificates_by_the_environment_and_a_name_that_would_not_be_heard(certs, monkeypatch):
    monkeypatch.setenv("LEGATO_CERTS", str(certs / "gripper"))
    monkeypatch.setenv("LEGATO_ENDPOINT", "tls/127.0.0.1:7447")
    done = subprocess.run(
        [sys.executable, "-m", "services.gripper", "--node=hand"],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("E-INVALID-VALUE --node is 'hand'; expected a")
