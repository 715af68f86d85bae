"""The control plane and the router as real processes: starting, refusing, dying, coming back."""

from __future__ import annotations

import contextlib
import json
import signal
import socket
import sqlite3
import subprocess
import sys
import threading
import time
from collections.abc import Iterator

import httpx
import pytest

from client.api import LegatoClient
from client.errors import RestError
from client.sse import parse_events
from common.api import PREFIX, EvaluationRequest
from common.bus import BusSettings
from common.keys import Role, create_key, revoke_key
from common.service import run_process
from tests.control_nodes import FakeSim, usual_nodes

pytestmark = pytest.mark.processes

WAIT_S = 30.0
"""Bound of every wait; reached only by a test that fails."""


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return probe.getsockname()[1]


def wait_until(condition):
    deadline_s = time.monotonic() + WAIT_S
    while time.monotonic() < deadline_s:
        if condition():
            return
        time.sleep(0.02)
    raise AssertionError("waited in vain")


class Processes:
    """A router and a control plane as processes; fake nodes as clients in threads."""

    def __init__(self, data) -> None:
        self.data = data
        self.router_port, self.port = free_port(), free_port()
        self.endpoint = f"tcp/127.0.0.1:{self.router_port}"
        self.http = httpx.Client(
            base_url=f"http://127.0.0.1:{self.port}", timeout=WAIT_S, trust_env=False
        )
        self.started: list[subprocess.Popen[str]] = []
        self.threads: list[threading.Thread] = []
        self.stop = threading.Event()
        self.sim = FakeSim("sim-0")

    def spawn(self, module: str, *arguments: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, "-m", module, *arguments],
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        self.started.append(process)
        return process

    def start_router(self) -> subprocess.Popen[str]:
        return self.spawn("services.router", f"--listen=127.0.0.1:{self.router_port}")

    def start_control(self, *, port: int | None = None, data=None) -> subprocess.Popen[str]:
        return self.spawn(
            "services.control",
            f"--port={port or self.port}",
            f"--data={data or self.data}",
            f"--endpoint={self.endpoint}",
        )

    def start_nodes(self) -> None:
        settings = BusSettings(endpoint=self.endpoint)
        for node in [self.sim, *usual_nodes(cells=0)]:
            options = {"node": node.node, "stop": self.stop}
            thread = threading.Thread(target=run_process, args=(node, settings), kwargs=options)
            self.threads.append(thread)
            thread.start()

    def is_ready(self) -> bool:
        try:
            return self.http.get("/readyz").is_success
        except httpx.TransportError:
            return False

    def post(self, trials: int) -> str:
        body = {"tasks": ["lid"], "robots": ["panda"], "policy": "expert", "trials": trials}
        response = self.http.post(f"{PREFIX}/evaluations", json=body)
        assert response.status_code == 202, response.text
        return response.json()["id"]

    def evaluation(self, identifier: str) -> dict:
        return self.http.get(f"{PREFIX}/evaluations/{identifier}").json()

    def trials(self, identifier: str) -> list[dict]:
        return self.http.get(f"{PREFIX}/evaluations/{identifier}/trials").json()

    def close(self) -> None:
        self.stop.set()
        for thread in self.threads:
            thread.join()
        self.http.close()
        for process in self.started:
            process.kill()
            process.communicate()


@pytest.fixture
def processes(tmp_path, request) -> Iterator[Processes]:
    interval_s = sys.getswitchinterval()
    processes = Processes(tmp_path / "runs")
    yield processes
    processes.close()
    sys.setswitchinterval(interval_s)


@pytest.fixture
def running(processes) -> Processes:
    processes.router = processes.start_router()
    processes.control = processes.start_control()
    processes.start_nodes()
    wait_until(processes.is_ready)
    return processes


def last_line(process) -> str:
    return process.communicate(timeout=WAIT_S)[1].splitlines()[-1]


def test_evaluation_ends_and_everything_stops_cleanly(running):
    evaluation = running.post(trials=3)
    wait_until(lambda: running.evaluation(evaluation)["status"] == "done")
    assert running.evaluation(evaluation)["cells"][0]["successes"] == 3
    services = {s["kind"]: s for s in running.http.get(f"{PREFIX}/services").json()}
    assert (services["router"]["alive"], services["router"]["node"]) == (True, "router")
    for process in (running.control, running.router):
        process.send_signal(signal.SIGTERM)
        assert process.wait(WAIT_S) == 0


def test_stop_sends_followers_away(running):
    running.sim.hold.set()
    evaluation = running.post(trials=1)
    names = []
    with running.http.stream("GET", f"{PREFIX}/evaluations/{evaluation}/events") as response:
        for event in parse_events(response.iter_lines()):
            if not names:
                running.control.send_signal(signal.SIGTERM)
            names.append(event.name)
    assert running.control.wait(WAIT_S) == 0
    assert set(names) == {"progress"}


def test_killed_control_plane_goes_on_and_repeats_nothing(running):
    evaluation = running.post(trials=40)
    wait_until(lambda: running.evaluation(evaluation)["trials_done"] >= 2)
    running.sim.hold.set()
    wait_until(lambda: [t["status"] for t in running.trials(evaluation)].count("running") == 1)
    before = [t for t in running.trials(evaluation) if t["status"] == "success"]
    running.control.kill()
    running.control.wait(WAIT_S)
    running.sim.hold.clear()
    running.control = running.start_control()
    wait_until(running.is_ready)
    wait_until(lambda: running.evaluation(evaluation)["status"] == "done")
    after = running.trials(evaluation)
    assert after[: len(before)] == before
    assert [len(t["attempts"]) for t in after].count(2) == 1
    assert {t["status"] for t in after} == {"success"}
    epochs = [attempt["epoch"] for trial in after for attempt in trial["attempts"]]
    assert epochs == sorted(set(epochs))


def test_killed_router_is_named_and_the_trial_is_run_again(running):
    running.sim.hold.set()
    evaluation = running.post(trials=1)
    wait_until(lambda: running.trials(evaluation)[0]["status"] == "running")
    running.router.kill()
    running.router.wait(WAIT_S)
    wait_until(lambda: running.trials(evaluation)[0]["status"] == "pending")
    (attempt,) = running.trials(evaluation)[0]["attempts"]
    assert attempt["reason"] == "router_left: router router left (process died or link lost)"
    wait_until(lambda: running.evaluation(evaluation)["waiting_for"] != [])
    running.sim.hold.clear()
    running.router = running.start_router()
    wait_until(lambda: running.evaluation(evaluation)["status"] == "done")
    assert running.trials(evaluation)[0]["status"] == "success"


def test_second_control_plane_is_refused_and_writes_nothing(running, tmp_path):
    second = running.start_control(port=free_port(), data=tmp_path / "other")
    assert last_line(second).startswith("E-ALREADY-RUNNING control is already running in namespace")
    assert second.returncode == 1
    assert not (tmp_path / "other").exists()


def test_broken_database_ends_the_process(running):
    with contextlib.closing(sqlite3.connect(running.data / "legato.db")) as connection:
        connection.execute("DROP TABLE attempts")
    running.post(trials=1)
    assert "no such table: attempts" in last_line(running.control)
    assert running.control.returncode == 1


def test_ports_that_are_taken_are_refused(processes, tmp_path):
    with (
        socket.create_server(("127.0.0.1", processes.port)),
        socket.create_server(("127.0.0.1", processes.router_port)),
    ):
        control, router = processes.start_control(), processes.start_router()
        for process, port in ((control, processes.port), (router, processes.router_port)):
            assert last_line(process).startswith(f"E-PORT-IN-USE port {port} on 127.0.0.1")
            assert process.returncode == 1
    assert not processes.data.exists()


def test_data_folder_that_cannot_be_written_is_refused(processes, tmp_path):
    (tmp_path / "file").write_text("")
    processes.start_router()
    control = processes.start_control(data=tmp_path / "file" / "runs")
    assert last_line(control).startswith("E-NOT-WRITABLE cannot write")
    assert control.returncode == 1


@pytest.mark.parametrize("listen", ["7447", "host:", "127.0.0.1:x", "127.0.0.1:99999"])
def test_wrong_address_of_the_router_is_refused(processes, listen):
    router = processes.spawn("services.router", f"--listen={listen}")
    assert last_line(router).startswith("E-INVALID-VALUE --listen is")
    assert router.returncode == 1


def test_address_of_another_machine_is_refused(processes):
    control = processes.spawn(
        "services.control", "--host=192.0.2.1", "--insecure-no-keys", f"--data={processes.data}"
    )
    assert last_line(control).startswith("E-INVALID-VALUE --host, --port is '192.0.2.1:8000'")
    assert control.returncode == 1


@pytest.mark.parametrize("host", ["0.0.0.0", "192.0.2.1", "[::]"])
def test_no_listener_for_others_without_protection(processes, host):
    control = processes.spawn("services.control", f"--host={host}", f"--data={processes.data}")
    router = processes.spawn("services.router", f"--listen={host}:{processes.router_port}")
    for process, said in (
        (control, f"E-EXPOSED REST at {host} would be open to whoever reaches it; expected "),
        (router, f"E-EXPOSED the bus at {host} would be open to whoever reaches it; expected "),
    ):
        assert last_line(process).startswith(said)
        assert process.returncode == 1
    assert not processes.data.exists()


def test_with_consent_they_listen_at_every_address_as_in_a_container(processes):
    address = f"--listen=0.0.0.0:{processes.router_port}"
    router = processes.spawn("services.router", address, "--insecure-plain-tcp")
    control = processes.spawn(
        "services.control",
        "--host=0.0.0.0",
        "--insecure-no-keys",
        f"--port={processes.port}",
        f"--data={processes.data}",
        f"--endpoint={processes.endpoint}",
    )
    wait_until(lambda: is_listening(processes.port))
    assert processes.http.get("/healthz").status_code == 200
    for process in (control, router):
        process.send_signal(signal.SIGTERM)
        assert process.wait(WAIT_S) == 0


def test_keys_and_consent_to_none_contradict(processes, tmp_path):
    create_key(tmp_path / "keys", name="ann", role=Role.VIEW)
    file = f"--api-keys-file={tmp_path / 'keys'}"
    control = processes.spawn("services.control", file, "--insecure-no-keys")
    assert last_line(control).startswith("E-INVALID-VALUE --insecure-no-keys is True")
    control = processes.spawn("services.control", f"--api-keys-file={tmp_path / 'none'}")
    assert last_line(control).startswith("E-KEY-FILE keys in")


def test_an_evaluation_with_keys_at_every_address(processes, tmp_path):
    keys = {role: create_key(tmp_path / "keys", name=role, role=role) for role in Role}
    processes.start_router()
    control = processes.spawn(
        "services.control",
        "--host=0.0.0.0",
        f"--port={processes.port}",
        f"--api-keys-file={tmp_path / 'keys'}",
        f"--data={processes.data}",
        f"--endpoint={processes.endpoint}",
    )
    processes.start_nodes()
    wait_until(processes.is_ready)
    url = str(processes.http.base_url)
    request = EvaluationRequest(tasks=["lid"], robots=["panda"], policy="expert", trials=2)
    with LegatoClient(url) as client, pytest.raises(RestError, match="no API key"):
        client.submit(request)
    with (
        LegatoClient(url, api_key=keys[Role.VIEW]) as client,
        pytest.raises(RestError, match="role"),
    ):
        client.submit(request)
    with LegatoClient(url, api_key=keys[Role.OPERATE]) as client:
        evaluation = client.wait(client.submit(request).id)
        assert evaluation.cells[0].successes == 2
        revoke_key(tmp_path / "keys", name="operate")
        with pytest.raises(RestError, match="revoked"):
            client.robots()
    control.send_signal(signal.SIGTERM)
    lines = [json.loads(line) for line in control.communicate(timeout=WAIT_S)[1].splitlines()]
    calls = [line for line in lines if line["event"] == "call"]
    assert [(line["caller"], line["status"]) for line in calls] == [
        (None, 401),
        ("view", 403),
        ("operate", 202),
        (None, 401),
    ]
    assert calls[2]["made"].endswith(evaluation.id)
    assert control.returncode == 0


def test_stop_while_there_is_no_router_is_clean(processes):
    control = processes.start_control()
    wait_until(lambda: is_listening(processes.port))
    control.send_signal(signal.SIGTERM)
    assert control.wait(WAIT_S) == 0
    assert not processes.data.exists()


def is_listening(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0
