"""Somebody with a valid certificate who sends commands that would end an episode."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from common.bus import Bus, BusSettings, Inbox, Received, decode, open_session
from common.messages import Header, RobotCommand, RobotState
from common.topics import topic_of


@contextmanager
def interfering(eyes: BusSettings, mouth: BusSettings, *, source: str) -> Iterator[list[int]]:
    """Answer every state of every robot with a command for no robot, faster than a retargeter.

    A simulation that hears one ends its episode: two values are too few for any robot.

    Args:
        eyes: Session of a role that hears states.
        mouth: Session of the role under which commands are sent.
        source: Node that they claim to come from.

    Yields:
        Ticks that were answered.
    """
    answered: list[int] = []
    stop = threading.Event()
    with (
        open_session(eyes) as seeing,
        open_session(mouth) as speaking,
        Bus(seeing) as eyes_bus,
        Bus(speaking) as mouth_bus,
    ):
        inbox = Inbox()
        eyes_bus.subscribe(topic_of(RobotState), inbox)
        thread = threading.Thread(target=_answer, args=(inbox, mouth_bus, source, answered, stop))
        thread.start()
        try:
            yield answered
        finally:
            stop.set()
            thread.join()


def _answer(
    inbox: Inbox, bus: Bus, source: str, answered: list[int], stop: threading.Event
) -> None:
    while not stop.is_set():
        inbox.wait(0.05)
        for item in inbox.drain()[1]:
            assert isinstance(item, Received)
            seen = decode(item.topic, item.encoding, item.payload).header
            header = Header(
                cell=seen.cell,
                episode=seen.episode,
                epoch=seen.epoch,
                step=seen.step,
                source=source,
                seq=seen.seq,
                t_mono_ns=seen.t_mono_ns,
            )
            command = RobotCommand(
                header=header,
                for_step=seen.step,
                request_t_mono_ns=seen.t_mono_ns,
                positions=[0.0, 0.0],
                velocities=[0.0, 0.0],
            )
            bus.publish(command, owner=seen.cell, mode="lockstep")
            answered.append(seen.step)
