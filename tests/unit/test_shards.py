"""Shards without a simulation: who runs what, what a file keeps, and what is refused."""

from __future__ import annotations

import errno
import fcntl
import json
from collections import Counter
from datetime import timedelta

import pytest

from client import main as cli
from client.sharding import code
from client.sharding.errors import (
    BadShard,
    NoShards,
    ShardInUse,
    ShardsDiffer,
    ShardsMissing,
    ShardsOverlap,
    as_ranges,
)
from client.sharding.header import Origin, ShardHeader
from client.sharding.merge import merge_shards
from client.sharding.record import read_shard
from client.sharding.shard import Shard
from client.sharding.writer import open_shard
from common.errors import InvalidValue, NotWritable
from services.control.grid import expand_grid
from tests.client_samples import PNG, WHEN, make_attempt, make_request, make_trial

ORIGIN = Origin(request=make_request(trials=4), versions={"legato": "0.1.0"}, code_sha256="cd" * 32)
GRID = expand_grid("e", ORIGIN.request)


def make_header(number=0, count=3, origin=ORIGIN) -> ShardHeader:
    created = WHEN + timedelta(seconds=number)
    return ShardHeader(
        number=number, count=count, digest=origin.digest, origin=origin, created_at=created
    )


def trial_of(number: int, **fields):
    spec = GRID[number]
    values = {
        "index": spec.index,
        "seed": spec.seed,
        "attempts": [make_attempt(finished_at=WHEN + timedelta(minutes=number))],
    }
    return make_trial(number, robot=spec.robot, **(values | fields))


def fill(folder, number=0, count=3, *, origin=ORIGIN, most=None, pictures=None) -> None:
    """Run a shard of numbers, or the first trials of it."""
    with open_shard(folder, make_header(number, count, origin), GRID) as writer:
        for trial in sorted(writer.missing)[:most]:
            writer.append(trial_of(trial), pictures or {})


def path_of(folder, number=0, count=3):
    return folder / Shard(number, count).file_name


@pytest.mark.parametrize("lanes", [1, 2, 5, 6, 12])
@pytest.mark.parametrize("trials", [1, 3, 20])
@pytest.mark.parametrize("count", [1, 2, 3, 5, 6, 7, 16, 100])
def test_every_trial_has_one_shard_and_every_robot_as_many_trials_in_each(lanes, trials, count):
    parts = [Shard(number, count).trials(trials * lanes) for number in range(count)]
    assert [trial for part in parts for trial in part] == list(range(trials * lanes))
    for lane in range(lanes):
        shares = [Counter(trial % lanes for trial in part)[lane] for part in parts]
        assert max(shares) - min(shares) <= 1


def test_shards_are_written_as_a_fraction():
    assert Shard.parse("2/8") == Shard(2, 8)
    assert str(Shard(2, 8)) == "2/8"


@pytest.mark.parametrize("text", ["", "8/8", "-1/8", "1", "1/0", "a/b", "0/100001", "1/8 "])
def test_what_is_no_shard_is_refused(text):
    with pytest.raises(InvalidValue, match="--shard"):
        Shard.parse(text)


def test_complete_shards_are_one_evaluation(tmp_path):
    for number in (2, 0, 1):
        fill(tmp_path, number, pictures={"end-scene": PNG})
    record = merge_shards(tmp_path)
    evaluation = record.evaluation
    assert evaluation.id == f"e-{ORIGIN.digest[:8]}"
    assert [trial.id for trial in record.trials] == list(range(8))
    assert {trial.evaluation for trial in record.trials} == {evaluation.id}
    assert [(cell.robot, cell.successes) for cell in evaluation.cells] == [
        ("abstract", 4),
        ("panda", 4),
    ]
    assert (evaluation.status, evaluation.trials_done) == ("done", 8)
    assert evaluation.versions == ORIGIN.versions
    assert (evaluation.created_at, evaluation.finished_at) == (WHEN, WHEN + timedelta(minutes=7))
    assert record.trials[5].pictures == ["end-scene"]
    assert record.picture(record.trials[5], "end-scene") == PNG


def test_what_is_read_is_what_was_written(tmp_path):
    fill(tmp_path)
    record = read_shard(path_of(tmp_path))
    assert record is not None
    assert record.header == make_header()
    expected = trial_of(0).model_copy(update={"evaluation": record.header.evaluation})
    assert record.trials[0] == expected


def test_more_shards_than_trials(tmp_path):
    for number in range(20):
        fill(tmp_path, number, 20)
    assert merge_shards(tmp_path).evaluation.trials_done == 8


def test_a_shard_goes_on_wherever_its_writer_was_stopped(tmp_path):
    """Cut at every byte: a trial is there once its line is whole, and nothing else is left."""
    fill(tmp_path / "whole", 2)
    whole = path_of(tmp_path / "whole", 2).read_bytes()
    path = path_of(tmp_path, 2)
    for size in range(0, len(whole), 61):
        path.write_bytes(whole[:size])
        complete = max(whole[:size].count(b"\n") - 1, 0)
        with open_shard(tmp_path, make_header(2), GRID) as writer:
            assert writer.missing == set(range(5 + complete, 8))
            for trial in sorted(writer.missing):
                writer.append(trial_of(trial), {})
        assert path.read_bytes() == whole


def test_room_without_bytes_at_the_end_is_cut_off(tmp_path):
    fill(tmp_path, 2, most=2)
    complete = path_of(tmp_path, 2).read_bytes()
    path_of(tmp_path, 2).write_bytes(complete + b"\0" * 40 + b"\n")
    with open_shard(tmp_path, make_header(2), GRID) as writer:
        assert writer.missing == {7}
    assert path_of(tmp_path, 2).read_bytes() == complete


@pytest.mark.parametrize(
    ("damage", "problem"),
    [
        (lambda lines: [lines[0], b"{}", *lines[1:]], "line 2 is not a trial"),
        (lambda lines: [*lines, lines[1], b""], "trial 5 does not belong there"),
        (lambda lines: [lines[0], lines[1].replace(b'"seed":', b'"seed":1'), b""], "trial 5 does"),
        (lambda lines: [lines[0], lines[1].replace(b'"id":5', b'"id":2'), b""], "trial 2 does"),
        (lambda lines: [lines[0].replace(b'"trials":4', b'"trials":5'), b""], "the digest is not"),
        (lambda lines: [lines[0].replace(b'"version":1', b'"version":2'), b""], "version: "),
        (lambda lines: [lines[0].replace(b'"number":2', b'"number":3'), b""], "number 3 of 3"),
        (lambda lines: [b"something else", b""], "Invalid JSON"),
    ],
)
def test_a_damaged_file_is_refused_by_both(tmp_path, damage, problem):
    fill(tmp_path, 2)
    lines = [line for line in path_of(tmp_path, 2).read_bytes().split(b"\n") if line]
    path_of(tmp_path, 2).write_bytes(b"\n".join(damage(lines)))
    with pytest.raises(BadShard, match=problem):
        merge_shards(tmp_path)
    with pytest.raises(BadShard, match=problem), open_shard(tmp_path, make_header(2), GRID):
        pass


def test_a_trial_that_has_not_ended_is_no_line(tmp_path):
    fill(tmp_path, 2)
    lines = path_of(tmp_path, 2).read_bytes().split(b"\n")
    lines[1] = lines[1].replace(b'"status":"success"', b'"status":"running"')
    path_of(tmp_path, 2).write_bytes(b"\n".join(lines))
    with pytest.raises(BadShard, match="line 2"):
        read_shard(path_of(tmp_path, 2))


def test_a_file_under_the_name_of_another_shard(tmp_path):
    fill(tmp_path, 0)
    path_of(tmp_path, 0).rename(path_of(tmp_path, 1))
    with (
        pytest.raises(BadShard, match="holds shard 0/3"),
        open_shard(tmp_path, make_header(1), GRID),
    ):
        pass


OTHERS = [
    ({"request": make_request(trials=4, seed=1)}, "seed 0"),
    ({"request": make_request(trials=4, tracking_lag_s=0.1)}, "tracking_lag_s 0.0"),
    ({"versions": {"legato": "0.2.0"}}, "version of legato 0.1.0"),
    ({"versions": {"legato": "0.1.0", "policy p": "ab"}}, "version of policy p nothing"),
    ({"code_sha256": "ef" * 32}, "code cdcdcdcdcdcd"),
]


@pytest.mark.parametrize(("change", "told"), OTHERS)
def test_shards_of_another_evaluation_are_refused_before_they_are_run(tmp_path, change, told):
    fill(tmp_path, 0)
    other = ORIGIN.model_copy(update=change)
    with pytest.raises(ShardsDiffer, match=told):
        fill(tmp_path, 1, origin=other)
    with pytest.raises(ShardsDiffer, match=told):
        fill(tmp_path, 0, origin=other)


@pytest.mark.parametrize(("change", "told"), OTHERS)
def test_shards_of_different_evaluations_are_not_merged(tmp_path, change, told):
    fill(tmp_path, 1)
    fill(tmp_path / "other", 0, origin=ORIGIN.model_copy(update=change))
    path_of(tmp_path / "other", 0).rename(path_of(tmp_path, 0))
    what = told.rsplit(" ", 1)[0]
    with pytest.raises(ShardsDiffer, match=what) as caught:
        merge_shards(tmp_path)
    assert caught.value.what == what


def test_shards_of_another_number_are_refused(tmp_path):
    fill(tmp_path, 0, 2)
    with pytest.raises(ShardsDiffer, match="number of shards 2; this command has 3"):
        fill(tmp_path, 0, 3)


def test_a_shard_in_two_files_is_refused(tmp_path):
    for number in range(3):
        fill(tmp_path, number)
    (tmp_path / "shard-copy.jsonl").write_bytes(path_of(tmp_path, 1).read_bytes())
    with pytest.raises(ShardsOverlap, match=r"shard 1/3 is in .*shard-00001.* and in .*copy"):
        merge_shards(tmp_path)


def test_missing_shards_are_named_as_they_are_run_again(tmp_path):
    fill(tmp_path, 0, 8)
    fill(tmp_path, 4, 8)
    path_of(tmp_path, 5, 8).touch()
    fill(tmp_path, 7, 8, most=0)
    with pytest.raises(ShardsMissing) as caught:
        merge_shards(tmp_path)
    assert caught.value.absent == (1, 2, 3, 5, 6)
    assert caught.value.unfinished == {7: (0, 1)}
    assert "missing: 1-3,5-6; not finished: 7 (0 of 1 trials)" in caught.value.happened
    assert "--array=1-3,5-7" in caught.value.action


def test_ranges():
    assert as_ranges([0]) == "0"
    assert as_ranges([0, 1, 2, 4, 6, 7]) == "0-2,4,6-7"


def test_a_folder_without_shards(tmp_path):
    with pytest.raises(NoShards, match="no shards in"):
        merge_shards(tmp_path / "nothing")


def test_one_shard_has_one_writer(tmp_path):
    with open_shard(tmp_path, make_header(0), GRID):
        with pytest.raises(ShardInUse), open_shard(tmp_path, make_header(0), GRID):
            pass
        with open_shard(tmp_path, make_header(1), GRID):
            pass
    with open_shard(tmp_path, make_header(0), GRID):
        pass


def refuse_locks(number):
    def flock(file, operation):
        raise OSError(number, "refused")

    return flock


def test_a_file_system_without_locks_is_told_of(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(fcntl, "flock", refuse_locks(errno.ENOLCK))
    fill(tmp_path)
    assert "has no locks" in caplog.text
    assert read_shard(path_of(tmp_path)).trials
    monkeypatch.setattr(fcntl, "flock", refuse_locks(errno.EIO))
    with pytest.raises(NotWritable, match="refused"):
        fill(tmp_path)


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(NotWritable):
        fill(tmp_path / "file")


def test_the_code_is_known_by_its_sources(tmp_path, monkeypatch):
    package = tmp_path / "package"
    package.mkdir()
    (package / "a.py").write_text("1")
    fake = type("Package", (), {"__path__": [str(package)], "__name__": "package"})
    monkeypatch.setattr(code, "common", fake)
    monkeypatch.setattr(code, "services", fake)
    first = code.hash_code()
    (package / "a.cpython.nbc").write_bytes(b"cache")
    assert code.hash_code() == first
    (package / "b.xml").write_text("")
    second = code.hash_code()
    (package / "a.py").write_text("2")
    assert len({first, second, code.hash_code()}) == 3


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--shard", "0/2"], "--shard without --out"),
        (["--workers", "2"], "--workers without --out"),
        (["--ray"], "--ray without --workers"),
        (["--ray", "--shard", "0/2", "--out", "d"], "--ray without --workers"),
        (["--out", "d"], "--out without --shard or --workers"),
        (["--shard", "0/2", "--workers", "2", "--out", "d"], "--shard and --workers are given"),
        (["--shard", "0/2", "--out", "d", "--json"], "a shard has no results of its own"),
        (["--shard", "0/2", "--out", "d", "--report", "r"], "a shard has no results of its own"),
        (["--pictures"], "--pictures without --shard"),
        (["--shard", "2/2", "--out", "d"], "--shard is '2/2'"),
        (["--workers", "0", "--out", "d"], "--workers is 0"),
    ],
)
def test_options_that_do_not_go_together(tmp_path, monkeypatch, capsys, arguments, told):
    monkeypatch.chdir(tmp_path)
    assert cli.run(["eval", *arguments]) == 2
    assert told in capsys.readouterr().err
    assert not (tmp_path / "d").exists()


def test_merge_shows_what_there_is(tmp_path, capsys):
    for number in range(3):
        fill(tmp_path, number, pictures={"end-scene": PNG})
    report = tmp_path / "report.html"
    assert cli.run(["eval", "merge", str(tmp_path), "--json", "--report", str(report)]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert [cell["successes"] for cell in shown["cells"]] == [4, 4]
    assert "data:image/png" in report.read_text()


def test_merge_of_nothing_is_exit_code_1(tmp_path, capsys):
    assert cli.run(["eval", "merge", str(tmp_path)]) == 1
    assert capsys.readouterr().err.startswith("E-NO-SHARDS")
