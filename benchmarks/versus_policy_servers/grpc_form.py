"""A policy server in the form of LeRobot's asynchronous inference: pickles in gRPC messages.

Written by us in that form: an observation is a pickled object that goes up in a stream of chunks of
2 MB; it waits in a queue of one; a second call asks for actions, which are a pickled list of timed
tensors, one per step. `thread`: as LeRobot's client, a thread of its own always has such a call
waiting. `after`: without a thread, the call is made when the observation is sent. Left out: what
LeRobot does to an observation before the network, and its log. Runs in an environment of its own
and imports nothing of LEGATO but `blocks`.
"""

from __future__ import annotations

import argparse
import os
import pickle
import queue
import sys
import threading
import time
from collections.abc import Iterator
from concurrent import futures
from dataclasses import dataclass, field
from typing import Any

import grpc
import numpy as np
import torch

from benchmarks.versus_policy_servers.blocks import (
    ACTION_NUMBERS,
    IMAGE_PX,
    add_arguments,
    answer_orders,
    tell,
)

CHUNK_BYTES = 2 * 1024 * 1024
MOST_BYTES = 4 * 1024 * 1024
WAIT_S = 2.0
OPTIONS = (
    ("grpc.max_receive_message_length", MOST_BYTES),
    ("grpc.max_send_message_length", MOST_BYTES),
)
PROTO = "benchmarks/versus_policy_servers/policy.proto"
messages, services = grpc.protos_and_services(PROTO)


@dataclass
class TimedObservation:
    """What the robot saw and when."""

    timestamp_s: float
    timestep: int
    observation: dict[str, Any] = field(repr=False)
    must_go: bool = True


@dataclass
class TimedAction:
    """One step of an answer."""

    timestamp_s: float
    timestep: int
    action: torch.Tensor


def split(data: bytes) -> Iterator[Any]:
    """The chunks of a byte string."""
    for start in range(0, len(data), CHUNK_BYTES):
        end = start + CHUNK_BYTES
        part = messages.END if end >= len(data) else messages.MIDDLE if start else messages.BEGIN
        yield messages.Chunk(part=part, data=data[start:end])


class Policy(services.PolicyServicer):
    """The server; a policy without a network.

    Args:
        steps: Of an answer.
    """

    def __init__(self, *, steps: int) -> None:
        self._steps = steps
        self._waiting: queue.Queue[TimedObservation] = queue.Queue(maxsize=1)

    def SendObservations(self, request_iterator: Iterator[Any], context: Any) -> Any:
        """Keep the newest observation."""
        data = b"".join(chunk.data for chunk in request_iterator)
        observation = pickle.loads(data)  # noqa: S301 what is compared
        if self._waiting.full():
            self._waiting.get_nowait()
        self._waiting.put(observation)
        return messages.Empty()

    def GetActions(self, request: Any, context: Any) -> Any:
        """Act on it, or answer with nothing after a while."""
        try:
            seen = self._waiting.get(timeout=WAIT_S)
        except queue.Empty:
            return messages.Actions()
        chunk = torch.full((self._steps, ACTION_NUMBERS), 1e-3)
        actions = [
            TimedAction(seen.timestamp_s, seen.timestep + number, action)
            for number, action in enumerate(chunk)
        ]
        return messages.Actions(data=pickle.dumps(actions))


def serve(port: int, *, steps: int) -> None:
    """Serve until killed."""
    server = grpc.server(futures.ThreadPoolExecutor(max_workers=4), options=OPTIONS)
    services.add_PolicyServicer_to_server(Policy(steps=steps), server)
    server.add_insecure_port(f"127.0.0.1:{port}")
    server.start()
    tell("ready")
    server.wait_for_termination()


class Asker:
    """The client.

    Args:
        stub: Of the server.
        in_thread: Whether a thread of its own asks for actions.
        steps: Of an answer.
    """

    def __init__(self, stub: Any, *, in_thread: bool, steps: int) -> None:
        self._steps = steps
        images = np.random.default_rng(0).integers(0, 256, (2, IMAGE_PX), dtype=np.uint8)
        self._left, self._right = (image.reshape(128, 128) for image in images)
        self._stub = stub
        self._step = 0
        self._arrived: queue.SimpleQueue[tuple[int, list[TimedAction]]] = queue.SimpleQueue()
        self._in_thread = in_thread
        if in_thread:
            threading.Thread(target=self._receive_for_ever, daemon=True).start()

    def round_trip(self) -> int:
        """Send one observation and wait for its actions; time in ns."""
        self._step += 10
        began_ns = time.perf_counter_ns()
        seen = {"t_sim_s": 0.01 * self._step, "left": self._left, "right": self._right}
        observation = TimedObservation(time.time(), self._step, seen)
        self._stub.SendObservations(split(pickle.dumps(observation)))
        if not self._in_thread:
            self._receive()
        arrived_ns, actions = self._arrived.get(timeout=5)
        shapes = {action.action.shape for action in actions}
        is_whole = len(actions) == self._steps and shapes == {(ACTION_NUMBERS,)}
        if actions[0].timestep != self._step or not is_whole:
            raise SystemExit(f"wrong answer: {actions}")
        return arrived_ns - began_ns

    def _receive(self) -> None:
        reply = self._stub.GetActions(messages.Empty())
        if reply.data:
            actions = pickle.loads(reply.data)  # noqa: S301 what is compared
            self._arrived.put((time.perf_counter_ns(), actions))

    def _receive_for_ever(self) -> None:
        while True:
            self._receive()


def ask(port: int, *, in_thread: bool, steps: int) -> None:
    """Be the client until standard input ends."""
    with grpc.insecure_channel(f"127.0.0.1:{port}", options=OPTIONS) as channel:
        stub = services.PolicyStub(channel)
        answer_orders(Asker(stub, in_thread=in_thread, steps=steps).round_trip)
        # The thread is inside gRPC, which does not like to be torn down around it.
        os._exit(0)


def main() -> int:
    """Serve or ask."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("role", choices=("serve", "thread", "after"))
    add_arguments(parser)
    args = parser.parse_args()
    if args.role == "serve":
        serve(args.port, steps=args.steps)
    else:
        ask(args.port, in_thread=args.role == "thread", steps=args.steps)
    return 0


if __name__ == "__main__":
    # Pickles name the module of what they hold, which has to be the same on both sides.
    from benchmarks.versus_policy_servers.grpc_form import main as main_of_module

    sys.exit(main_of_module())
