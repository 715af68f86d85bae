"""An evaluation as server-sent events."""

from __future__ import annotations

from collections.abc import AsyncGenerator

from fastapi.concurrency import run_in_threadpool

from common.api import ProgressEvent
from services.control.plane import ControlPlane

MEDIA_TYPE = "text/event-stream"
HEARTBEAT_S = 10.0


async def follow(
    plane: ControlPlane, evaluation: str, *, heartbeat_s: float = HEARTBEAT_S
) -> AsyncGenerator[str, None]:
    """Events of an evaluation: `progress` now and at each change, `end` after the last one.

    A comment each `heartbeat_s` tells the reader that silence is not a broken link. The stream
    stops without `end` when the control plane does: the reader may come back.
    """
    with plane.subscriptions.follow(evaluation) as subscription:
        trial: int | None = None
        while True:
            event = await run_in_threadpool(plane.progress, evaluation, trial)
            yield _format("progress", event)
            # The state is newer than the change that was asked about: tell of the others first.
            if event.evaluation.status != "running" and not subscription.is_behind:
                yield _format("end", event)
                return
            while (change := await subscription.next_change(heartbeat_s)) is None:
                yield ": heartbeat\n\n"
            if change.closing:
                return
            trial = change.trial


def _format(name: str, event: ProgressEvent) -> str:
    return f"event: {name}\ndata: {event.model_dump_json()}\n\n"
