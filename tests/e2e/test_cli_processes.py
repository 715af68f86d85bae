"""The commands with real processes. Whatever a test does, nothing may be left running."""

from __future__ import annotations

import json
import os
import secrets
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import psutil
import pytest

from client.deployment import HOST, find_free_ports

pytestmark = pytest.mark.processes

MARK = "LEGATO_TEST_RUN"
PATIENT = "--lease-s=10"
"""For what is to come to its end on a machine that may be busy with other things."""


@dataclass(frozen=True)
class Shell:
    """Runs `legato` in a folder; every process it starts carries a mark."""

    folder: Path
    mark: str

    def start(self, *arguments: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, "-m", "client.main", *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=self.folder,
            env=os.environ | {MARK: self.mark, "PYTHONPATH": str(Path(__file__).parents[2])},
        )

    def run(self, *arguments: str, timeout_s: float = 120.0) -> tuple[int, str, str]:
        with self.start(*arguments) as process:
            out, err = process.communicate(timeout=timeout_s)
        return process.returncode, out, err

    def left(self) -> list[psutil.Process]:
        """Processes that carry the mark and still run."""
        return [process for process in psutil.process_iter() if self._is_marked(process)]

    def _is_marked(self, process: psutil.Process) -> bool:
        try:
            return process.environ().get(MARK) == self.mark
        except psutil.Error:
            return False


@pytest.fixture
def shell(tmp_path) -> Iterator[Shell]:
    shell = Shell(tmp_path, secrets.token_hex(8))
    yield shell
    left = shell.left()
    for process in left:
        process.kill()
    assert not left


@pytest.fixture
def ports() -> list[str]:
    router, rest = find_free_ports(2)
    return [f"--router-port={router}", f"--port={rest}"]


def url_of(ports: list[str]) -> str:
    return f"--url=http://{HOST}:{ports[1].partition('=')[2]}"


def endpoint_of(ports: list[str]) -> str:
    return f"--endpoint=tcp/{HOST}:{ports[0].partition('=')[2]}"


def wait_for(condition: Callable[[], object], *, within_s: float = 30.0) -> None:
    deadline_s = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < deadline_s, "did not happen in time"
        time.sleep(0.02)


def test_demo_leaves_a_report_and_nothing_else(shell):
    code, out, err = shell.run("demo", "--trials", "1", "--cells", "1", "--data", "runs")
    assert code == 0, err
    (report,) = shell.folder.glob("runs/demo-*/report.html")
    assert f"report: {report.relative_to(shell.folder)}" in out
    text = report.read_text()
    assert "legato demo --trials 1" in text
    assert text.count('<section class="episode">') == 2
    assert [line.split()[:2] for line in out.splitlines()[2:4]] == [
        ["lid", "abstract"],
        ["lid", "panda"],
    ]
    assert not shell.left()


def has_started(process: subprocess.Popen[str], data: Path) -> bool:
    # Before its handlers are there a signal ends Python itself: nothing runs yet.
    return data.exists()


def has_a_process(process: subprocess.Popen[str], data: Path) -> bool:
    return bool(list(data.glob("demo-*/logs/router.log")))


def has_a_database(process: subprocess.Popen[str], data: Path) -> bool:
    return bool(list(data.glob("demo-*/legato.db")))


def has_a_result(process: subprocess.Popen[str], data: Path) -> bool:
    assert process.stderr is not None
    return "trial 0" in process.stderr.readline()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("moment", [has_started, has_a_process, has_a_database, has_a_result])
def test_demo_interrupted_leaves_nothing(shell, number, moment):
    data = shell.folder / "runs"
    with shell.start("demo", "--trials", "20", "--data", str(data)) as process:
        wait_for(lambda: process.poll() is not None or moment(process, data), within_s=60.0)
        process.send_signal(number)
        process.send_signal(number)
        _, err = process.communicate(timeout=120)
    assert process.returncode == 130, err
    assert "Traceback" not in err
    assert not shell.left()


@pytest.fixture
def deployment(shell, ports) -> Iterator[list[str]]:
    code, _, err = shell.run(
        "up", "--robot=abstract", "--namespace=test", "--data=d", PATIENT, *ports
    )
    assert code == 0, err
    yield ports
    assert shell.run("down", "--data=d") == (0, "stopped\n", "")


def test_up_status_eval_topic_down(shell, deployment):
    url = url_of(deployment)
    code, out, _ = shell.run("status", "--json", url)
    assert code == 0
    nodes = {each["node"]: each["alive"] for each in json.loads(out)["services"]}
    assert {"sim-0", "retarget-abstract", "gripper", "policy"} <= set(nodes)
    assert all(nodes.values())

    code, _, err = shell.run("up", "--data=d", *deployment)
    assert (code, err.split()[0]) == (1, "E-ALREADY-RUNNING")
    code, _, err = shell.run("up", "--data=other", *deployment)
    assert (code, err.split()[0]) == (1, "E-PORT-IN-USE")

    code, _, err = shell.run("eval", "--task=lidd", "--robot=abstract", url)
    assert code == 2
    assert 'no task "lidd"' in err

    code, out, err = shell.run("eval", "--robot=abstract", "--trials=1", "--json", url)
    assert code == 0, err
    assert "lid abstract expert  trial 0" in err
    over_rest = json.loads(out)["cells"][0]
    code, out, err = shell.run("eval", "--robot=abstract", "--trials=1", "--json", "--in-process")
    assert code == 0, err
    here = json.loads(out)["cells"][0]
    for name in ("successes", "median_hand_error_m", "trace_sha256"):
        assert here[name] == over_rest[name]

    bus = [endpoint_of(deployment), "--namespace=test"]
    code, out, err = shell.run("topic", "echo", "metrics", "--count=1", *bus)
    assert code == 0, err
    assert json.loads(out)["node"] in nodes

    def hear_both() -> bool:
        code, out, err = shell.run("topic", "hz", "metrics", "--duration-s=2.5", "--json", *bus)
        assert code == 0, err
        return {rate["key"] for rate in json.loads(out)} >= {"metrics/sim-0", "metrics/policy"}

    # Every process says it once a second, if it gets the time.
    wait_for(hear_both, within_s=120.0)
    code, out, _ = shell.run("topic", "list", *bus)
    assert code == 0
    assert "robot/state" in out


def test_a_killed_service_comes_back(shell, deployment):
    def pid_of_policy() -> int | None:
        services = json.loads(shell.run("status", "--json", url_of(deployment))[1])["services"]
        alive = [each["pid"] for each in services if each["node"] == "policy" and each["alive"]]
        return alive[0] if alive else None

    first = pid_of_policy()
    assert first is not None
    os.kill(first, signal.SIGKILL)
    wait_for(lambda: pid_of_policy() not in (None, first))


def test_nothing_outlives_a_killed_supervisor(shell, ports):
    code, _, err = shell.run("up", "--robot=abstract", "--data=d", *ports)
    assert code == 0, err
    state = json.loads((shell.folder / "d" / "supervisor.json").read_text())
    os.kill(state["pid"], signal.SIGKILL)
    wait_for(lambda: not shell.left())
    assert shell.run("down", "--data=d")[1].startswith("nothing runs in ")


def test_up_in_the_foreground_ends_with_a_signal(shell, ports):
    with shell.start("up", "--foreground", "--robot=abstract", "--data=d", *ports) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if line.startswith("stop with"):
                break
        process.send_signal(signal.SIGTERM)
        _, err = process.communicate(timeout=120)
    assert process.returncode == 0, err


def test_an_unknown_robot_stops_the_start(shell, ports):
    code, _, err = shell.run("up", "--robot=pnda", "--data=d", *ports)
    assert code != 0
    assert "pnda" in err


def test_eval_without_services_says_what_to_run(shell, ports):
    code, out, err = shell.run("eval", "--trials=1", url_of(ports))
    assert (code, out) == (1, "")
    assert err.startswith("E-CONTROL")
    assert "run: legato up" in err


def test_in_process_interrupted_shows_what_is_done(shell):
    with shell.start("eval", "--in-process", "--robot=abstract", "--trials=500", "--json") as run:
        assert run.stderr is not None
        run.stderr.readline()
        run.send_signal(signal.SIGINT)
        out, err = run.communicate(timeout=120)
    assert run.returncode == 130, err
    (cell,) = json.loads(out)["cells"]
    assert 1 <= cell["successes"] + cell["failures"] < 500


def test_topic_without_router_says_so(shell):
    code, _, err = shell.run("topic", "list", "--endpoint=tcp/127.0.0.1:1")
    assert (code, err.split()[0]) == (1, "E-ROUTER")
