from __future__ import annotations

import pytest

from common.clock import LockstepBarrier, RealtimePacer

MS = 1_000_000


def barrier() -> LockstepBarrier:
    return LockstepBarrier(resend_s=0.4, deadline_s=1.6)


def test_a_barrier_is_complete_when_all_have_answered():
    b = barrier()
    b.open(["command", "motor"])
    assert not b.complete
    b.arrive("command")
    b.arrive("command")
    b.arrive("something nobody asked for")
    assert not b.complete
    b.arrive("motor")
    assert b.complete


def test_silence_first_resends_then_names_who_is_missing():
    b = barrier()
    b.open(["command", "motor"])
    b.arrive("motor")
    verdicts = {t: b.check(t * MS) for t in range(0, 1601, 100)}
    assert [t for t, v in verdicts.items() if v.resend] == [400, 800, 1200]
    assert b.resends == 3
    assert verdicts[1500].overdue == ()
    assert verdicts[1600].overdue == ("command",)


def test_an_answered_tick_starts_a_new_count():
    b = barrier()
    b.open(["command"])
    b.check(0)
    b.check(1500 * MS)
    b.arrive("command")
    b.open(["command"])
    assert b.check(1700 * MS).overdue == ()


def test_a_late_step_does_not_shift_the_following_ones():
    pacer = RealtimePacer(period_s=0.01)
    taken = [t for t in range(60) if t != 20 and pacer.due(t * MS)]
    assert taken == [0, 10, 21, 30, 40, 50]


def test_a_long_stall_is_skipped_and_counted():
    pacer = RealtimePacer(period_s=0.01, max_behind=5)
    assert pacer.due(0)
    assert pacer.due(1000 * MS)
    assert pacer.skipped == pytest.approx(99, abs=1)
    assert not pacer.due(1000 * MS + 1)
