from __future__ import annotations

import json
import socket
from pathlib import Path

import pytest

from client.commands import Up
from client.deployment import HOST, Deployment, find_free_ports, is_port_free
from client.errors import NodesMissing, ProcessGaveUp
from client.processes import RestartPolicy, read_last_line, spawn
from client.readiness import find_missing, wait_until_ready
from client.verbs import deploy
from client.verbs.deploy import up
from common.errors import InvalidValue, PortInUse
from tests.client_samples import make_service


def commands(deployment: Deployment) -> dict[str, tuple[str, tuple[str, ...]]]:
    return {spec.node: (spec.module, spec.arguments) for spec in deployment.processes()}


def test_processes_of_a_deployment():
    deployment = Deployment(robots=("abstract", "panda"), cells=2, namespace="ns")
    shown = commands(deployment)
    assert list(shown) == [
        *("router", "control", "sim-0", "sim-1"),
        *("retarget-abstract", "retarget-panda", "gripper", "policy"),
    ]
    module, arguments = shown["retarget-panda"]
    assert module == "services.retarget"
    assert {"--robot=panda", "--node=retarget-panda", "--namespace=ns"} <= set(arguments)
    assert "--endpoint=tcp/127.0.0.1:7447" in arguments
    assert "--listen=127.0.0.1:7447" in shown["router"][1]
    assert {"--host=127.0.0.1", "--port=8000", "--data=runs"} <= set(shown["control"][1])
    assert not any(argument.startswith("--node") for argument in shown["control"][1])


def test_checkpoints_go_to_the_policy_service(tmp_path):
    given = "--checkpoints="
    for checkpoints in (None, tmp_path):
        shown = commands(Deployment(checkpoints=checkpoints))
        arguments = [each for _, own in shown.values() for each in own if each.startswith(given)]
        assert arguments == ([] if checkpoints is None else [f"{given}{tmp_path}"])
        assert set(arguments) <= set(shown["policy"][1])


def test_every_process_is_told_the_lease_if_there_is_one():
    assert not any(
        "--lease-s" in each for _, own in commands(Deployment()).values() for each in own
    )
    for _, own in commands(Deployment(lease_s=2.5)).values():
        assert "--lease-s=2.5" in own


def test_a_lease_that_would_lose_everybody_is_refused(tmp_path):
    with pytest.raises(InvalidValue, match="--lease-s"):
        up(Up(data=tmp_path, lease_s=0.1))


def test_every_process_has_the_certificate_of_its_role(tmp_path):
    shown = commands(Deployment(robots=("abstract",), certs=tmp_path))
    roles = {"retarget-abstract": "retarget", "sim-0": "sim", "policy": "expert"}
    for node, (_, arguments) in shown.items():
        assert f"--certs={tmp_path / roles.get(node, node)}" in arguments
        assert ("--endpoint=tls/127.0.0.1:7447" in arguments) == (node != "router")


def test_a_folder_of_certificates_that_is_not_there_is_refused_up_front(tmp_path):
    with pytest.raises(InvalidValue, match="--certs"):
        up(Up(data=tmp_path, certs=tmp_path / "none"))
    assert list(tmp_path.iterdir()) == []


def test_each_process_has_a_port_of_its_own_for_metrics(tmp_path):
    assert list(Deployment().metrics_ports()) == []
    deployment = Deployment(robots=("abstract",), metrics_port=9464, data=tmp_path)
    shown = commands(deployment)
    assert [own[-1] for _, own in shown.values()] == [
        f"--metrics-port={port}" for port in range(9464, 9470)
    ]
    deployment.write_targets()
    targets = json.loads(deployment.targets.read_text())
    assert targets[0] == {"targets": ["127.0.0.1:9464"], "labels": {"process": "router"}}
    assert [each["labels"]["process"] for each in targets] == list(shown)


def test_ports_of_metrics_are_checked_up_front():
    with socket.create_server((HOST, 0)) as server:
        taken = server.getsockname()[1]
        rest, router = find_free_ports(2)
        with pytest.raises(PortInUse, match=rf"port {taken} .*metrics"):
            Deployment(rest_port=rest, router_port=router, metrics_port=taken).check_ports()
    with pytest.raises(InvalidValue, match="--metrics-port"):
        up(Up(metrics_port=65535))


def test_a_port_of_the_environment_is_not_given_to_every_process(tmp_path, monkeypatch):
    monkeypatch.setenv("LEGATO_METRICS_PORT", "9464")
    path = tmp_path / "out"
    with path.open("wb") as output:
        spawn("tests.print_environment", (), output).wait(60)
    shown = path.read_text().split()
    assert "OMP_NUM_THREADS" in shown
    assert "LEGATO_METRICS_PORT" not in shown


def test_a_folder_of_checkpoints_that_is_not_there_is_refused_up_front(tmp_path):
    with pytest.raises(InvalidValue, match="--checkpoints") as caught:
        up(Up(data=tmp_path, checkpoints=tmp_path / "none"))
    assert caught.value.http_status == 422
    assert list(tmp_path.iterdir()) == []


def test_a_relative_folder_of_checkpoints_outlives_the_shells_folder(tmp_path, monkeypatch):
    planned = []
    monkeypatch.setattr(deploy, "_stay", lambda deployment: planned.append(deployment) or 0)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "trained").mkdir()
    rest, router = find_free_ports(2)
    checkpoints = Path("trained")
    up(Up(port=rest, router_port=router, checkpoints=checkpoints, foreground=True))
    assert planned[0].checkpoints == tmp_path / "trained"


def test_deployment_survives_json():
    deployment = Deployment(cells=3, rest_port=1234, checkpoints=Path("trained"))
    assert Deployment.model_validate_json(deployment.model_dump_json()) == deployment


def test_ports_in_use_are_refused_up_front():
    with socket.create_server((HOST, 0)) as server:
        taken = server.getsockname()[1]
        (free,) = find_free_ports(1)
        assert not is_port_free(taken)
        with pytest.raises(PortInUse, match=rf"port {taken} .*REST"):
            Deployment(rest_port=taken, router_port=free).check_ports()
        with pytest.raises(PortInUse, match="router"):
            Deployment(rest_port=free, router_port=taken).check_ports()


def test_free_ports_differ_and_are_free():
    ports = find_free_ports(4)
    assert len(set(ports)) == 4
    assert all(is_port_free(port) for port in ports)


def test_restart_pauses_grow_to_five_seconds():
    policy = RestartPolicy()
    pauses = [policy.pause_s(lifetime_s=3.0, code=-9) for _ in range(9)]
    assert pauses == [0.0, 0.2, 0.4, 0.8, 1.6, 3.2, 5.0, 5.0, 5.0]


def test_a_long_life_is_forgiven():
    policy = RestartPolicy()
    for _ in range(4):
        policy.pause_s(lifetime_s=3.0, code=-9)
    assert policy.pause_s(lifetime_s=60.0, code=-9) == 0.0


def test_three_early_errors_running_are_enough():
    policy = RestartPolicy()
    assert policy.pause_s(lifetime_s=0.1, code=1) == 0.0
    assert policy.pause_s(lifetime_s=0.1, code=1) == 0.2
    assert policy.pause_s(lifetime_s=0.1, code=1) is None


@pytest.mark.parametrize(("lifetime_s", "code"), [(2.5, 1), (0.1, -9), (0.1, 0)])
def test_other_deaths_interrupt_the_count(lifetime_s, code):
    policy = RestartPolicy(early_errors=2)
    assert policy.pause_s(lifetime_s=lifetime_s, code=code) is not None
    assert policy.early_errors == 0


def test_last_line_of_a_log(tmp_path):
    path = tmp_path / "node.log"
    assert read_last_line(path) == ""
    path.write_text("x" * 20_000 + "\nfirst\nlast\n\n")
    assert read_last_line(path) == "last"


class FakeControl:
    """A control plane that shows one more node at each look."""

    def __init__(self, services):
        self.waiting, self.shown, self.looks = list(services), [], 0

    def services(self):
        if self.waiting:
            self.shown.append(self.waiting.pop(0))
        return self.shown

    def ready(self):
        self.looks += 1
        return self.looks > 1


def everything(deployment: Deployment):
    return [make_service(spec.kind, spec.node) for spec in deployment.processes()]


def test_ready_when_every_node_is_alive_and_control_says_so():
    deployment = Deployment()
    control = FakeControl(everything(deployment))
    services = wait_until_ready(control, deployment, given_up=dict)
    assert len(services) == len(deployment.processes())
    assert control.looks == 2


def test_missing_nodes_are_named_with_their_last_words(tmp_path):
    deployment = Deployment(data=tmp_path)
    deployment.logs.mkdir()
    (deployment.logs / "policy.log").write_text("no checkpoint\n")
    alive = [service for service in everything(deployment) if service.kind != "policy"]
    dead = make_service("policy", "policy", alive=False)
    assert find_missing(deployment, [*alive, dead]) == ["policy"]
    control = FakeControl([])
    control.shown = alive
    with pytest.raises(NodesMissing, match=r"(?s)policy not alive.*no checkpoint") as caught:
        wait_until_ready(control, deployment, given_up=dict, deadline_s=0.0)
    assert caught.value.missing == ("policy",)


def test_a_process_that_was_given_up_ends_the_wait(tmp_path):
    with pytest.raises(ProcessGaveUp, match="policy: no checkpoint"):
        wait_until_ready(
            FakeControl([]),
            Deployment(data=tmp_path),
            given_up=lambda: {"policy": "no checkpoint"},
        )
