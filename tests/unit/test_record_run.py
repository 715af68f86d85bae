"""Recording with real processes that make episodes of numbers instead of simulating."""

from __future__ import annotations

import io
import json
import logging
import os
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from client import main as cli
from client.commands import DemoRecord
from client.errors import UnknownNames
from client.recording import pool, recorder
from client.recording.errors import WorkerDied, YieldTooLow
from client.recording.parts import list_parts, part_path, read_part, write_part
from client.recording.plan import Plan, make_plan
from client.recording.pool import WorkerPool
from client.recording.progress import BarProgress, LineRecordingProgress, describe_pace
from client.recording.recorder import record
from client.recording.report import WorkerOrder
from client.recording.variation import Variation
from client.recording.worker import Orders
from client.verbs.record import format_summary
from common.api import EvaluationRequest
from common.calibration import load_calibration
from common.datasets import (
    CameraSpec,
    ColumnSpec,
    DatasetSpec,
    EpisodeStore,
    EpisodeWriter,
)
from common.datasets.errors import BadDataset, OtherDataset
from common.errors import InvalidValue, LegatoError, UnknownName
from tests.recording_worker import make_episode

SPEC = DatasetSpec(
    task="lid",
    robot="abstract",
    rate_hz=10.0,
    tick_rate_hz=100.0,
    reference_delay_ticks=0,
    camera=CameraSpec.of(load_calibration("t265")),
    action_convention="none",
    columns=(ColumnSpec(name="value", dtype="f64", shape=(3,), unit="-", meaning="numbers"),),
    recording={"seed": 0},
    software={},
)


@pytest.fixture(autouse=True)
def fake_worker(monkeypatch):
    command = (sys.executable, "-m", "tests.recording_worker")
    monkeypatch.setattr(pool, "COMMAND", command)
    monkeypatch.chdir(Path(__file__).parents[2])


def make_recording(folder: Path, episodes: int = 4, *, workers: int = 1, **changes) -> Plan:
    robot = changes.pop("robot", "abstract")
    request = EvaluationRequest(tasks=["lid"], robots=[robot], policy="expert", trials=1)
    fields = {"episodes": episodes, "workers": workers, "keep_failed": False, "folder": folder}
    return Plan(request=request, **(fields | changes))


def run(plan: Plan, *, stop: threading.Event | None = None) -> tuple[recorder.Summary, list[str]]:
    told = io.StringIO()
    summary = record(
        plan, SPEC, progress=LineRecordingProgress(told), stop=stop or threading.Event()
    )
    return summary, told.getvalue().splitlines()


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.processes
def test_the_first_successes_are_stored_in_order_whoever_makes_them(tmp_path):
    summary, lines = run(make_recording(tmp_path / "1"))
    run(make_recording(tmp_path / "3", workers=3))
    assert contents(tmp_path / "1") == contents(tmp_path / "3")
    store = EpisodeStore.open(tmp_path / "1")
    assert [info.trial for info in store.episodes] == [0, 2, 3, 5]
    assert [info.seed for info in store.episodes] == [100, 102, 103, 105]
    assert np.array_equal(store[2]["value"], make_episode(3, "success")[0].columns["value"])
    assert not (tmp_path / "1" / "parts").exists()
    assert (summary.episodes, summary.successes, summary.trials, summary.rows) == (4, 4, 6, 12)
    assert lines[1] == "   1/4  trial 1  failure  because"
    assert len(lines) == 6


@pytest.mark.processes
def test_failed_demonstrations_are_kept_when_asked_for_and_do_not_count(tmp_path):
    summary, _ = run(make_recording(tmp_path, workers=2, keep_failed=True))
    outcomes = [info.outcome for info in EpisodeStore.open(tmp_path).episodes]
    assert outcomes == ["success", "failure", "success", "success", "failure", "success"]
    assert (summary.episodes, summary.successes) == (6, 4)


@pytest.mark.processes
def test_the_same_command_again_has_nothing_to_do_and_a_larger_one_goes_on(tmp_path):
    run(make_recording(tmp_path / "a", 2))
    before = contents(tmp_path / "a")
    summary, lines = run(make_recording(tmp_path / "a", 2))
    assert (summary.episodes, contents(tmp_path / "a")) == (2, before)
    assert lines == ["going on after trial 2: 2 of 2 demonstrations are there"]
    run(make_recording(tmp_path / "a", 4, workers=2))
    run(make_recording(tmp_path / "b", 4))
    assert contents(tmp_path / "a") == contents(tmp_path / "b")


@pytest.mark.processes
def test_an_interrupted_recording_goes_on_with_what_is_complete(tmp_path, caplog):
    """A finished episode whose turn had not come, a damaged one, and half an appended one."""
    with EpisodeWriter.open(tmp_path / "a", SPEC) as out:
        out.append(*make_episode(0, "success"))
    parts = tmp_path / "a" / "parts"
    parts.mkdir()
    write_part(parts, *make_episode(3, "success"))
    made = part_path(parts, 3).stat().st_mtime_ns
    part_path(parts, 2).write_bytes(b"PK half a file")
    part_path(parts, 5).with_suffix(".4711").write_bytes(b"unfinished")
    with (tmp_path / "a" / "value.f64").open("ab") as file:
        file.write(b"half")
    assert list_parts(parts) == {2, 3}
    assert made == part_path(parts, 3).stat().st_mtime_ns
    with caplog.at_level(logging.WARNING):
        _, lines = run(make_recording(tmp_path / "a"))
    assert "cut off 1 rows" in caplog.records[0].getMessage()
    assert lines[0] == "going on after trial 0: 1 of 4 demonstrations are there"
    run(make_recording(tmp_path / "b"))
    assert contents(tmp_path / "a") == contents(tmp_path / "b")


@pytest.mark.processes
def test_a_stop_keeps_what_is_complete(tmp_path):
    stop = threading.Event()
    stop.set()
    summary, _ = run(make_recording(tmp_path), stop=stop)
    assert summary.episodes == 0
    assert (tmp_path / "parts").is_dir()
    run(make_recording(tmp_path))
    assert EpisodeStore.open(tmp_path).verify() == []


@pytest.mark.processes
@pytest.mark.parametrize(
    ("robot", "reason"),
    [("crash-2", "RuntimeError: the world ended"), ("killed-2", "killed by SIGKILL")],
)
def test_a_worker_that_dies_is_told_with_its_reason(tmp_path, robot, reason):
    with pytest.raises(WorkerDied) as caught:
        run(make_recording(tmp_path, robot=robot))
    assert (caught.value.worker, caught.value.trial, caught.value.reason) == (0, 2, reason)
    assert [info.trial for info in EpisodeStore.open(tmp_path).episodes] == [0]


@pytest.mark.processes
def test_a_worker_that_cannot_start_is_told_of(tmp_path, monkeypatch):
    monkeypatch.setattr(pool, "COMMAND", (sys.executable, "-c", "import nothing_of_this_name"))
    with pytest.raises(WorkerDied, match="No module named 'nothing_of_this_name'"):
        run(make_recording(tmp_path))
    monkeypatch.setattr(pool, "COMMAND", (sys.executable, "-c", "raise SystemExit(3)"))
    with pytest.raises(WorkerDied, match="exit code 3 without a word"):
        run(make_recording(tmp_path))
    code = "print('hello', flush=True); input(); input()"
    monkeypatch.setattr(pool, "COMMAND", (sys.executable, "-c", code))
    with pytest.raises(WorkerDied, match="wrote 'hello' instead of a report"):
        run(make_recording(tmp_path))


@pytest.mark.processes
def test_a_hopeless_recording_ends(tmp_path):
    with pytest.raises(YieldTooLow, match="0 of 20 trials succeeded"):
        run(make_recording(tmp_path, robot="hopeless", workers=2))


@pytest.mark.processes
def test_an_aborted_trial_is_told_and_never_stored(tmp_path):
    plan = make_recording(tmp_path, 2, robot="aborts-0", keep_failed=True)
    summary, lines = run(plan)
    assert [info.trial for info in EpisodeStore.open(tmp_path).episodes] == [1, 2, 3]
    assert summary.aborted == 1
    assert lines[0] == "   0/2  trial 0  aborted  because"
    assert "1 aborted" in format_summary(tmp_path, summary)


@pytest.mark.processes
def test_leaving_the_pool_leaves_no_process(tmp_path):
    order = WorkerOrder(
        task="lid",
        robot="abstract",
        camera="t265",
        policy="expert",
        seed=0,
        keep_failed=False,
        parts=str(tmp_path),
    )
    with WorkerPool(order, count=2) as workers:
        pids = [worker.pid for worker in workers.workers]
        assert workers.next_report(timeout_s=0.0) is None
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


def test_a_part_that_vanished_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(recorder, "read_part", lambda folder, trial: None)
    with pytest.raises(BadDataset, match="damaged or removed"):
        run(make_recording(tmp_path))


def test_parts_are_whole_or_nothing(tmp_path):
    rows, about = make_episode(7, "success")
    write_part(tmp_path, rows, about)
    assert [path.name for path in tmp_path.iterdir()] == ["trial-000007.npz"]
    again = read_part(tmp_path, 7)
    assert again is not None
    assert again[1] == about
    assert np.array_equal(again[0].columns["value"], rows.columns["value"])
    whole = part_path(tmp_path, 7).read_bytes()
    for cut in range(0, len(whole), 97):
        part_path(tmp_path, 7).write_bytes(whole[:cut])
        assert read_part(tmp_path, 7) is None
    changed = bytearray(whole)
    changed[whole.index(rows.columns["value"].tobytes()) + 3] ^= 1
    part_path(tmp_path, 7).write_bytes(bytes(changed))
    assert read_part(tmp_path, 7) is None
    assert read_part(tmp_path, 8) is None


def test_orders_end_with_their_stream():
    stop = threading.Event()
    assert list(Orders(io.StringIO("4\n7\n"), stop)) == [4, 7]
    assert stop.wait(5.0)


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.processes
def test_the_bar_shows_yield_and_failures(tmp_path):
    screen = Terminal()
    with BarProgress(screen) as progress:
        record(make_recording(tmp_path, 2), SPEC, progress=progress, stop=threading.Event())
    assert "2/2" in screen.getvalue()
    assert "yield 67 %" in screen.getvalue()
    assert "trial 1  failure  because" in screen.getvalue()


def test_pace_counts_this_run_only():
    ledger = recorder.Ledger(wanted=100, trials=50, successes=40)
    assert describe_pace(ledger, since=40, elapsed_s=9.0) == "yield 80 %"
    assert describe_pace(ledger, since=30, elapsed_s=60.0) == "yield 80 %  10.0/min  6:00 left"


def test_a_plan_from_the_arguments(tmp_path):
    plan = make_plan(DemoRecord(task="cup", robot="panda", seed=3, episodes=1, workers=8))
    assert plan.folder == Path("runs/demonstrations/cup-panda-3")
    assert (plan.workers, plan.request.seed, plan.request.pictures) == (1, 3, False)
    assert make_plan(DemoRecord(out=tmp_path)).folder == tmp_path
    assert make_plan(DemoRecord()).workers >= 1


@pytest.mark.parametrize(
    ("changes", "option"),
    [
        ({"episodes": 0}, "--episodes"),
        ({"workers": -1}, "--workers"),
        ({"seed": -1}, "--seed"),
        ({"task": "a b"}, "--task"),
        ({"camera": "a b"}, "--camera"),
    ],
)
def test_wrong_values_are_named(changes, option):
    with pytest.raises(InvalidValue) as caught:
        make_plan(DemoRecord(**changes))
    assert caught.value.field == option


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        ({"task": "lidd"}, UnknownNames),
        ({"robot": "x"}, UnknownNames),
        ({"camera": "x"}, UnknownName),
    ],
)
def test_unknown_names_are_refused_before_anything_is_made(tmp_path, changes, error):
    with pytest.raises(error):
        make_plan(DemoRecord(out=tmp_path / "d", **changes)).describe()
    assert not (tmp_path / "d").exists()


def test_a_data_set_says_where_it_comes_from():
    spec = make_plan(DemoRecord(seed=4)).describe()
    assert spec.recording == {
        "policy": "expert",
        "seed": 4,
        "mode": "lockstep",
        "keep_failed": False,
        "variation": Variation().model_dump(),
    }
    assert spec.software.keys() >= {"legato", "mujoco-core", "numpy", "pin"}


def test_another_seed_is_another_data_set(tmp_path):
    with EpisodeWriter.open(tmp_path, SPEC):
        pass
    with pytest.raises(OtherDataset, match=r"recording\.seed 0, not 1"):
        EpisodeWriter.open(tmp_path, SPEC.model_copy(update={"recording": {"seed": 1}}))


@pytest.mark.parametrize(
    ("words", "found"),
    [
        (["demo"], ("demo",)),
        (["demo", "--trials", "1"], ("demo",)),
        (["demo", "record", "--task", "cup"], ("demo", "record")),
    ],
)
def test_demo_is_a_verb_and_a_family(words, found):
    assert cli.find_verb(words)[0] == found


def test_a_misspelt_record_is_named(capsys):
    assert cli.run(["demo", "recrod"]) == 2
    assert "did you mean: record" in capsys.readouterr().err


def test_view_and_check_answer_in_json(tmp_path, capsys):
    with EpisodeWriter.open(tmp_path, SPEC) as out:
        out.append(*make_episode(0, "success"))
    assert cli.run(["data", "view", str(tmp_path), "--json"]) == 0
    seen = json.loads(capsys.readouterr().out)
    assert (seen["rows"], seen["dataset"]["task"], len(seen["episodes"])) == (2, "lid", 1)
    assert cli.run(["data", "check", str(tmp_path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["problems"], found["episodes"]) == ([], 1)
    assert found["not_checked"] == ["gaps", "skew", "jumps", "stillness", "replay"]


def test_view_tells_totals_and_an_unfinished_end(tmp_path, capsys, caplog):
    with EpisodeWriter.open(tmp_path, SPEC) as out:
        out.append(*make_episode(4, "failure"))
    with (tmp_path / "value.f64").open("ab") as file:
        file.write(b"half")
    assert cli.run(["data", "view", str(tmp_path)]) == 0
    seen = capsys.readouterr()
    assert "0        4      104   failure  3     0.3     reason 4" in seen.out
    assert "1 episodes (1 failed), 3 rows" in seen.out
    assert "belong to no complete episode" in caplog.text


def test_a_sheet_of_an_episode_that_does_not_exist(tmp_path, capsys):
    with EpisodeWriter.open(tmp_path, SPEC) as out:
        out.append(*make_episode(0, "success"))
    arguments = ["data", "view", str(tmp_path), "--sheet", str(tmp_path / "s.png")]
    assert cli.run([*arguments, "--episode", "1"]) == 2
    assert "--episode is 1; expected 0 to 0" in capsys.readouterr().err
    assert cli.run(arguments) == 2
    assert 'no column "images"' in capsys.readouterr().err


def test_no_data_set_is_exit_code_1(tmp_path, capsys):
    assert cli.run(["data", "view", str(tmp_path)]) == 1
    assert capsys.readouterr().err.startswith("E-NO-DATASET")
    assert issubclass(WorkerDied, LegatoError)
