"""The heartbeat file and what looks at it."""

from __future__ import annotations

import os
import subprocess
import sys
import time

import pytest

from common.errors import NotWritable
from common.health import OLDEST_S, PERIOD_S, VARIABLE, Heartbeat, check, main


def test_a_process_that_has_just_touched_its_file_is_ready(tmp_path):
    heartbeat = Heartbeat(tmp_path / "heartbeat")
    heartbeat.beat(0)
    assert check(heartbeat) is None


def test_before_the_first_beat_it_is_not_ready(tmp_path):
    assert check(Heartbeat(tmp_path / "heartbeat")) == "not ready yet: no heartbeat"


@pytest.mark.parametrize("sign", [-1, 1], ids=["old", "clock was set back"])
def test_an_old_beat_counts_as_none(tmp_path, sign):
    path = tmp_path / "heartbeat"
    path.touch()
    then_s = time.time() + sign * (OLDEST_S + 60)
    os.utime(path, (then_s, then_s))
    assert "hangs or has lost the router" in str(check(Heartbeat(path)))


def test_without_the_variable_there_is_nothing_to_look_at(monkeypatch):
    monkeypatch.delenv(VARIABLE, raising=False)
    assert Heartbeat.from_environment() is None
    assert VARIABLE in str(check(None))


def test_a_beat_is_due_once_a_period(tmp_path):
    heartbeat = Heartbeat(tmp_path / "heartbeat")
    period_ns = int(PERIOD_S * 1e9)
    assert heartbeat.is_due(5)
    heartbeat.beat(5)
    assert not heartbeat.is_due(4 + period_ns)
    assert heartbeat.is_due(5 + period_ns)


def test_a_file_that_cannot_be_touched_is_an_error(tmp_path):
    with pytest.raises(NotWritable, match="nowhere"):
        Heartbeat(tmp_path / "nowhere" / "heartbeat").beat(0)


def test_the_exit_code_says_it(tmp_path, monkeypatch, capsys):
    path = tmp_path / "heartbeat"
    monkeypatch.setenv(VARIABLE, str(path))
    assert main() == 1
    path.touch()
    assert main() == 0
    assert capsys.readouterr().out == "not ready yet: no heartbeat\nready\n"


def test_looking_is_light():
    heavy = "{'numpy', 'pydantic', 'services', 'zenoh'}"
    code = f"import common.health, sys; sys.exit(bool({heavy} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
