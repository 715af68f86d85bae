"""Recording with the simulation: the same command gives the same bytes, whatever happens to it."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest

from common.datasets import EpisodeStore
from services.control.grid import trial_seed

pytestmark = pytest.mark.processes

EPISODES = 2
DOCS = Path(__file__).parents[2] / "docs" / "data.md"


def start(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "client.main", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
    )


def legato(*arguments: str) -> tuple[int, str, str]:
    with start(*arguments) as process:
        out, err = process.communicate(timeout=240)
    return process.returncode, out, err


def record_arguments(folder: Path, *, workers: int) -> list[str]:
    words = ["demo", "record", "--task", "lid", "--robot", "abstract"]
    return [*words, "--episodes", str(EPISODES), "--workers", str(workers), "--out", str(folder)]


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def workers_of(process: subprocess.Popen[str]) -> list[psutil.Process]:
    """Its workers, once there is one."""
    deadline_s = time.monotonic() + 60
    while time.monotonic() < deadline_s:
        children = [child for child in psutil.Process(process.pid).children() if is_worker(child)]
        if children:
            return children
        time.sleep(0.05)
    raise AssertionError("no worker was started")


def is_worker(process: psutil.Process) -> bool:
    """Whether it is one: imports start short-lived processes too."""
    try:
        return "client.recording.worker" in process.cmdline()
    except psutil.Error:
        return False


def wait_for_an_episode(folder: Path, *, beyond: int = 0) -> None:
    index = folder / "episodes.jsonl"
    deadline_s = time.monotonic() + 120
    while not index.exists() or index.read_bytes().count(b"\n") <= beyond:
        assert time.monotonic() < deadline_s
        time.sleep(0.02)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded") / "lid"
    code, out, err = legato(*record_arguments(folder, workers=1))
    assert code == 0, err
    assert f"{folder}: 2 episodes" in out
    assert "trial 0  success" in err
    return folder


def test_two_workers_record_what_one_does(recorded, tmp_path):
    code, _, err = legato(*record_arguments(tmp_path / "two", workers=2))
    assert code == 0, err
    assert contents(tmp_path / "two") == contents(recorded)


def test_a_recording_survives_interrupts_and_deaths(recorded, tmp_path):
    """Ctrl-C after one episode, a worker that is killed, then the command itself."""
    folder = tmp_path / "lid"
    arguments = record_arguments(folder, workers=1)
    with start(*arguments) as process:
        wait_for_an_episode(folder)
        workers = workers_of(process)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "interrupted; run the same command again to go on" in err
    assert "1 episodes" in out
    assert not any(worker.is_running() for worker in workers)

    with start(*arguments) as process:
        workers_of(process)[0].kill()
        _, err = process.communicate(timeout=60)
    assert process.returncode == 1
    assert "E-WORKER-DIED" in err
    assert "killed by SIGKILL" in err

    with start(*arguments) as process:
        workers = workers_of(process)
        process.kill()
    _, alive = psutil.wait_procs(workers, timeout=60)
    assert not alive, "a worker outlives whoever gave it orders"

    assert len(EpisodeStore.open(folder)) == 1
    code, _, err = legato(*arguments)
    assert code == 0, err
    assert "going on after trial 0: 1 of 2 demonstrations are there" in err
    assert contents(folder) == contents(recorded)


def test_what_is_recorded_is_one_demonstration_after_another(recorded):
    store = EpisodeStore.open(recorded)
    assert (store.spec.task, store.spec.robot, len(store)) == ("lid", "abstract", EPISODES)
    assert [info.seed for info in store.episodes] == [trial_seed(0, 0), trial_seed(0, 1)]
    for episode in store:
        images, tool, closed = episode["images"], episode["tool_pose"], episode["grasp"]
        assert images.shape == (len(episode), 2, 128, 128)
        assert np.all(np.diff(episode["frame_step"]) == 10)
        # Both eyes see a scene that changes; they see it from different places.
        assert images.std() > 20
        assert not np.array_equal(images[:, 0], images[:, 1])
        assert not np.array_equal(images[0], images[-1])
        # The lid is carried: it and the hand come to rest elsewhere, the fingers open again.
        assert np.abs(tool[-1, :3] - tool[0, :3]).max() > 0.05
        assert (closed[0], closed.max(), closed[-1]) == (0, 1, 0)
        assert np.abs(episode["object_lid"][-1, :3] - episode["object_lid"][0, :3]).max() > 0.05


def test_view_and_check(recorded, tmp_path):
    sheet = tmp_path / "sheet.png"
    code, out, _ = legato("data", "view", str(recorded), "--sheet", str(sheet))
    assert code == 0
    assert "2 episodes (0 failed)" in out
    assert sheet.read_bytes().startswith(b"\x89PNG")
    code, out, err = legato("data", "check", str(recorded), "--json")
    assert (code, err) == (0, "")
    report = json.loads(out)
    assert report["problems"] == []
    assert report["measured"]["replay error, m"] < 1e-9
    assert report["measured"]["image to state skew, ticks"] == 0
    assert report["measured"]["dropped frames"] == 0


def test_the_documentation_is_true_of_it(recorded, capsys):
    """Its code runs on what was recorded, and its table names every column."""
    text = DOCS.read_text(encoding="utf-8")
    spec = EpisodeStore.open(recorded).spec
    for column in spec.columns:
        name = "object_<name>" if column.privileged else column.name
        assert f"`{name}`" in text
    (code,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    exec(code.replace("runs/demonstrations/lid-abstract-0", str(recorded)), {})
    assert capsys.readouterr().out.startswith(f"{trial_seed(0, 0)} [")
