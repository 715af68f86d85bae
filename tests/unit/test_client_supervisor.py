"""The supervisor with real child processes: small modules written by the tests."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable

import pytest

from client.deployment import Deployment, ProcessSpec
from client.supervisor import Supervisor, open_deployment, read_state, state_path
from common.errors import AlreadyRunning

pytestmark = pytest.mark.processes

WAITS = "import signal; print('up', flush=True); signal.pause()"
IGNORES_TERM = (
    "import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('up', flush=True);"
    "signal.pause(); signal.pause()"
)
FAILS = "import sys; print('no model'); sys.exit(1)"


@pytest.fixture
def run_module(tmp_path, monkeypatch):
    """Make a process specification from the source of a module."""
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))

    def make(node: str, source: str) -> ProcessSpec:
        (tmp_path / f"fake_{node}.py").write_text(source)
        return ProcessSpec("fake", node, f"fake_{node}", ())

    return make


def wait_for(condition: Callable[[], object], *, within_s: float = 10.0) -> None:
    deadline_s = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < deadline_s, "did not happen in time"
        time.sleep(0.01)


def is_gone(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return False


def says_up(logs, node: str, times: int = 1) -> bool:
    path = logs / f"{node}.log"
    return path.exists() and path.read_text().count("up") >= times


def test_starts_logs_and_stops(run_module, tmp_path):
    with Supervisor([run_module("a", WAITS), run_module("b", WAITS)], logs=tmp_path) as supervisor:
        supervisor.start()
        wait_for(lambda: says_up(tmp_path, "a") and says_up(tmp_path, "b"))
        pids = supervisor.pids
        assert set(pids) == {"a", "b"}
    assert all(is_gone(pid) for pid in pids.values())


def test_children_are_in_sessions_of_their_own(run_module, tmp_path):
    with Supervisor([run_module("a", WAITS)], logs=tmp_path) as supervisor:
        supervisor.start()
        wait_for(lambda: says_up(tmp_path, "a"))
        assert os.getsid(supervisor.pids["a"]) == supervisor.pids["a"]


def test_restarts_what_was_killed(run_module, tmp_path):
    with Supervisor([run_module("a", WAITS)], logs=tmp_path) as supervisor:
        supervisor.start()
        wait_for(lambda: says_up(tmp_path, "a"))
        first = supervisor.pids["a"]
        os.kill(first, signal.SIGKILL)
        wait_for(lambda: says_up(tmp_path, "a", times=2))
        assert supervisor.pids["a"] != first
        assert not supervisor.given_up


def test_gives_up_with_the_last_line(run_module, tmp_path):
    told = []
    specs = [run_module("bad", FAILS), run_module("good", WAITS)]
    with Supervisor(specs, logs=tmp_path, on_give_up=told.append) as supervisor:
        supervisor.start()
        wait_for(lambda: told)
        assert supervisor.given_up == {"bad": "no model"}
        assert "good" in supervisor.pids
    assert told == [{"bad": "no model"}]
    assert (tmp_path / "bad.log").read_text().count("no model") == 3


def test_kills_what_ignores_sigterm(run_module, tmp_path, monkeypatch):
    monkeypatch.setattr("client.supervisor.GRACE_S", 0.2)
    with Supervisor([run_module("a", IGNORES_TERM)], logs=tmp_path) as supervisor:
        supervisor.start()
        wait_for(lambda: says_up(tmp_path, "a"))
        pid = supervisor.pids["a"]
    assert is_gone(pid)


def test_stop_before_start_starts_nothing(run_module, tmp_path):
    supervisor = Supervisor([run_module("a", WAITS)], logs=tmp_path)
    supervisor.stop()
    supervisor.start()
    supervisor.stop()
    assert supervisor.pids == {}
    assert not (tmp_path / "a.log").exists()


@pytest.fixture
def idle_deployment(tmp_path, monkeypatch):
    monkeypatch.setattr(Deployment, "processes", lambda _: ())
    return Deployment(data=tmp_path / "data")


def test_a_data_folder_has_one_supervisor(idle_deployment):
    assert read_state(idle_deployment.data) is None
    with open_deployment(idle_deployment):
        state = read_state(idle_deployment.data)
        assert state is not None
        assert (state.pid, state.deployment) == (os.getpid(), idle_deployment)
        with (
            pytest.raises(AlreadyRunning, match="already running"),
            open_deployment(idle_deployment),
        ):
            pass
        assert read_state(idle_deployment.data) is not None
    assert read_state(idle_deployment.data) is None
    assert not state_path(idle_deployment.data).exists()


def test_the_file_of_a_killed_supervisor_says_nothing(idle_deployment):
    with open_deployment(idle_deployment):
        left_behind = state_path(idle_deployment.data).read_text()
    state_path(idle_deployment.data).write_text(left_behind)
    assert read_state(idle_deployment.data) is None
