"""Followers of an evaluation and what waits for them."""

from __future__ import annotations

import asyncio

from services.control.subscriptions import Change, Subscriptions

MOST_WAITING = 1024


def test_a_follower_that_does_not_read_loses_the_oldest_changes():
    async def run() -> list[Change | None]:
        subscriptions = Subscriptions()
        with subscriptions.follow("e-1") as follower:
            for trial in range(5000):
                subscriptions.notify("e-1", trial)
            seen: list[Change | None] = [await follower.next_change(5.0)]
            while follower.is_behind:
                seen.append(await follower.next_change(5.0))
        assert len(subscriptions) == 0
        return seen

    seen = asyncio.run(run())
    assert [each and each.trial for each in seen] == list(range(5000 - MOST_WAITING, 5000))
