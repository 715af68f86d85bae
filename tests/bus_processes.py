"""A publisher and a subscriber as processes.

`python -m tests.bus_processes publish|subscribe ENDPOINT NAMESPACE TOPIC`
"""

from __future__ import annotations

import os
import sys

from common import messages as m
from common.bus import Bus, BusSettings, Inbox, open_session
from common.messages import Message
from common.topics import topic_named

CELL = "sim-0"
SIDE = 128
FRAME_BYTES = 2 * SIDE * SIDE


def make(topic: str, seq: int) -> Message:
    """A stereo frame or a picture of the same size, both of noise."""
    header = m.Header(cell=CELL, epoch=1, seq=seq, step=seq)
    if topic == "episode/picture":
        return m.EpisodePicture(
            header=header,
            moment="end",
            view="scene",
            width=2 * SIDE,
            height=SIDE,
            channels=1,
            pixels=os.urandom(FRAME_BYTES),
        )
    eye = os.urandom(SIDE * SIDE)
    return m.StereoFrame(
        header=header, camera="t265", width=SIDE, height=SIDE, left=eye, right=eye, due_step=-1
    )


def publish(bus: Bus, topic: str) -> None:
    """Send as many messages as each line of standard input says, as fast as the bus takes them."""
    for line in sys.stdin:
        for seq in range(int(line)):
            bus.publish(make(topic, seq), owner=CELL, mode="realtime")
        say("sent")


def subscribe(bus: Bus, topic: str) -> None:
    """Say each time that something has come."""
    inbox = Inbox()
    bus.subscribe(topic_named(topic), inbox)
    while True:
        if inbox.wait(0.1):
            inbox.drain()
            say("came")


def say(word: str) -> None:
    """One line to the test."""
    sys.stdout.write(f"{word}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    role, endpoint, namespace, topic = sys.argv[1:]
    settings = BusSettings(endpoint=endpoint, namespace=namespace)
    with open_session(settings) as session, Bus(session) as bus:
        {"publish": publish, "subscribe": subscribe}[role](bus, topic)
