"""Images and Compose files as users start them."""

from __future__ import annotations

import time
from collections.abc import Callable

import pytest

from client.api import LegatoClient
from common.api import Evaluation, EvaluationRequest
from tests.compose.projects import Project, docker, started
from tests.deployments import wait_until_done

pytestmark = pytest.mark.compose

FAMILIES = ("router", "control", "sim", "gripper", "retarget", "policy")
LARGEST_OWN_MB = 450
"""Of the simulation, without the base image: 600 MB on python:3.11-slim-bookworm."""
LIST_PACKAGES = "ls /venv/lib/python3*/site-packages"
SERVICE = "$(cat /proc/1/task/1/children)"
"""Process 1 of a container is its init, which has one child."""


def wait_until(condition: Callable[[], bool], *, timeout_s: float = 60.0) -> None:
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline_s, "waited in vain"
        time.sleep(0.2)


def evaluate(client: LegatoClient, **request) -> Evaluation:
    """Run an evaluation of the lid on REST to its end."""
    wait_until(client.ready)
    evaluation = client.submit(EvaluationRequest(tasks=["lid"], **request))
    return wait_until_done(client, evaluation.id, timeout_s=600.0)


def alive(client: LegatoClient, kind: str) -> set[str]:
    return {node.node for node in client.services() if node.kind == kind and node.alive}


def test_the_expert_closes_the_lid_on_two_robots(system):
    found = evaluate(system.client, robots=["abstract", "panda"], policy="expert", trials=1)
    assert [(cell.robot, cell.successes) for cell in found.cells] == [("abstract", 1), ("panda", 1)]


def test_the_shipped_policy_runs_without_torch(system):
    found = evaluate(system.client, robots=["abstract", "panda"], policy="legato-lid", trials=1)
    assert [(cell.done, cell.aborted) for cell in found.cells] == [(1, 0), (1, 0)]
    packages = system.project.inside("policy", LIST_PACKAGES).split()
    assert "onnxruntime" in packages
    assert "torch" not in packages


def test_the_command_line_is_in_the_image(system):
    assert "legato-lid" in system.project.inside("control", "legato policy list")


def test_no_container_has_rights_that_it_does_not_need(system):
    containers = system.project.containers()
    assert len(containers) == len(FAMILIES) + 1
    for container in containers:
        host = container["HostConfig"]
        assert container["Config"]["User"] == "10001:10001"
        assert host["ReadonlyRootfs"] is True
        assert host["CapDrop"] == ["ALL"]
        assert host["CapAdd"] is None
        assert host["Privileged"] is False
        assert host["SecurityOpt"] == ["no-new-privileges:true"]
        assert host["Init"] is True
        assert 0 < host["PidsLimit"] <= 128
        assert 0 < host["Memory"] <= 2**30
        assert host["RestartPolicy"]["Name"] == "unless-stopped"


def test_the_bus_has_no_way_out(system):
    networks = system.project.config()["networks"]
    assert networks["bus"]["internal"] is True
    on_edge = {
        container["Config"]["Labels"]["com.docker.compose.service"]
        for container in system.project.containers()
        if networks["edge"]["name"] in container["NetworkSettings"]["Networks"]
    }
    assert on_edge == {"control", "router"}


@pytest.mark.usefixtures("images")
def test_ports_are_for_this_machine_only():
    services = Project().config()["services"]
    ports = [port for service in services.values() for port in service.get("ports", [])]
    assert {port["host_ip"] for port in ports} == {"127.0.0.1"}
    assert {port["published"] for port in ports} == {"7447", "8000"}


@pytest.mark.usefixtures("images")
def test_the_image_of_the_simulation_is_small(system):
    assert "torch" not in system.project.inside("sim", LIST_PACKAGES).split()
    base = system.project.config()["services"]["sim"]["build"]["args"]["BASE"]
    sim, under = (
        int(docker("image", "inspect", "-f", "{{.Size}}", x)) for x in ("legato-sim", base)
    )
    assert (sim - under) / 1e6 < LARGEST_OWN_MB


def test_the_camera_is_compiled_in_the_image(system):
    evaluate(system.client, robots=["abstract"], policy="expert", trials=1)
    # Numba adds a file for what it has to compile anew.
    assert system.project.inside("sim", "find /kernels -name '*.nbc' | wc -l").strip() == "1"
    assert system.project.inside("sim", "diff -r /kernels /tmp/kernels") == ""


@pytest.mark.usefixtures("images")
@pytest.mark.parametrize("target", [*FAMILIES, "sim"])
def test_images_have_nothing_to_build_with(target):
    look = "command -v pip gcc cc make /venv/bin/pip /code/bin/legato || true"
    assert docker("run", "--rm", "--entrypoint=sh", f"legato-{target}", "-c", look) == ""


def test_a_process_that_hangs_is_unhealthy(system):
    def health() -> str:
        return system.project.containers("gripper")[0]["State"]["Health"]["Status"]

    system.project.inside("gripper", f"kill -STOP {SERVICE}")
    wait_until(lambda: health() == "unhealthy")
    system.project.inside("gripper", f"kill -CONT {SERVICE}")
    wait_until(lambda: health() == "healthy")


def test_a_process_that_dies_comes_back(system):
    def restarts() -> int:
        return system.project.containers("gripper")[0]["RestartCount"]

    before = restarts()
    # The shell may go down with the container before it has said how the command ended.
    system.project.run("exec", "-T", "gripper", "sh", "-c", f"kill -KILL {SERVICE}")
    wait_until(lambda: restarts() > before)
    found = evaluate(system.client, robots=["panda"], policy="expert", trials=1)
    assert found.cells[0].successes == 1


def test_more_simulations_are_more_cells(system):
    system.project.up("--scale=sim=2")
    wait_until(lambda: len(alive(system.client, "sim")) == 2)
    found = evaluate(system.client, robots=["abstract"], policy="expert", trials=4)
    assert found.cells[0].successes == 4
    trials = system.client.trials(found.id)
    used = {attempt.cell for trial in trials for attempt in trial.attempts}
    assert used == alive(system.client, "sim")
    system.project.up("--scale=sim=1")


def test_a_policy_on_another_host(system):
    system.project.up("--scale=policy=0")
    wait_until(lambda: not alive(system.client, "policy"))
    env = {"ZENOH_ROUTER": f"tcp/{system.router}"}
    with started(Project(files=("compose.policy.yaml",), env=env)):
        found = evaluate(system.client, robots=["abstract"], policy="legato-lid", trials=1)
        assert alive(system.client, "policy") == {"policy-remote"}
    assert (found.cells[0].done, found.cells[0].aborted) == (1, 0)
    system.project.up()


@pytest.mark.usefixtures("images")
def test_a_policy_alone_asks_for_its_router():
    done = Project(files=("compose.policy.yaml",)).run("config")
    assert done.returncode != 0
    assert "ZENOH_ROUTER" in done.stderr


@pytest.mark.usefixtures("images")
@pytest.mark.parametrize("file", ["compose.yaml", "compose.policy.yaml"])
def test_the_gpu_file_fits_beside_both(file):
    env = {"ZENOH_ROUTER": "tcp/10.0.0.5:7447"}
    policy = Project(files=(file, "compose.gpu.yaml"), env=env).config()["services"]["policy"]
    assert policy["build"]["target"] == "policy-gpu"
    devices = policy["deploy"]["resources"]["reservations"]["devices"]
    assert devices[0]["capabilities"] == ["gpu"]
    assert policy["read_only"] is True


@pytest.mark.usefixtures("images")
def test_nothing_is_left_after_down(images):
    project = Project(env={"LEGATO_PORT": "0", "LEGATO_ROUTER": "127.0.0.1:0"})
    with started(project, "router", "gripper"):
        assert len(project.containers()) == 2
    label = f"label=com.docker.compose.project={project.name}"
    for what in ("ps", "network", "volume"):
        verb = ("ps", "--all") if what == "ps" else (what, "ls")
        assert docker(*verb, "--quiet", "--filter", label) == ""
