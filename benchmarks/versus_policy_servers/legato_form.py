"""LEGATO's policy service and a cell that asks it, as processes on Zenoh.

The service is the real one (reactor, runner, bus, codec, messages) with a policy that has no
network; the cell is a reactor under the same runner. A round trip is made of a stereo frame that is
built, checked, packed, relayed by the router, unpacked and checked again, and of an action that
goes the same way back.
"""

from __future__ import annotations

import argparse
import functools
import sys
import threading
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.versus_policy_servers.blocks import (
    ACTION_NUMBERS,
    IMAGE_PX,
    add_arguments,
    read_orders,
    tell,
)
from common.bus import BusSettings
from common.messages import (
    ActionStep,
    EpisodeConfigure,
    EpisodeReady,
    Header,
    LocalMessage,
    NodeUp,
    PolicyAction,
    StereoFrame,
    Tick,
)
from common.service import AnyMessage, Host, Reactor, run_process
from services.policy.policy import Observation
from services.policy.reactor import PolicyReactor

CELL, SERVER = "cell", "policy"
EPISODE = Header(cell=CELL, episode="round-trips", epoch=1)
RESEND_NS = 400_000_000
"""Silence after which a frame is sent again, as by the simulation; the time goes on."""


class Still:
    """A policy that looks at nothing and hardly moves.

    Args:
        steps: Of an answer.
    """

    needs_truth = False

    def __init__(self, *, steps: int) -> None:
        self._steps = steps

    def reset(self, *, seed: int, task: str) -> None:
        """Forget nothing."""
        del seed, task

    def act(self, observation: Observation) -> list[ActionStep]:
        """Small steps."""
        del observation
        small = [1e-3, 1e-3, 1e-3]
        return [
            ActionStep(translation_m=small, rotation_rad=small, grasp=False)
            for _ in range(self._steps)
        ]


@dataclass(frozen=True)
class Order(LocalMessage):
    """Make a block of round trips."""

    count: int
    period_s: float


@dataclass(frozen=True)
class Measured(LocalMessage):
    """How long the round trips of a block took."""

    times_ns: list[int]


class Asker(Reactor):
    """Sends frames and waits for their actions, as the owner of a cell.

    Args:
        steps: Of an answer.
    """

    kind = "sim"
    inputs = (EpisodeReady, PolicyAction)
    watches_nodes = True

    def __init__(self, *, steps: int) -> None:
        self._steps = steps
        images = np.random.default_rng(0).integers(0, 256, (2, IMAGE_PX), dtype=np.uint8)
        self._left, self._right = (image.tobytes() for image in images)
        self._order = Order(0, 0.0)
        self._times_ns: list[int] = []
        self._configured = False
        self._step = 0
        self._tries = 1
        self._asked_ns: int | None = None

    @property
    def owned_cell(self) -> str:
        """Its cell."""
        return CELL

    @property
    def tick_period_s(self) -> float:
        """The pace of a paced block."""
        return self._order.period_s or 0.1

    def handle(self, messages: Sequence[AnyMessage]) -> Iterable[AnyMessage]:
        """Take orders and actions, return frames."""
        return [output for message in messages for output in self._handle_one(message)]

    def _handle_one(self, message: AnyMessage) -> list[AnyMessage]:
        if isinstance(message, PolicyAction):
            return self._take(message)
        if isinstance(message, Tick):
            return self._pass_time()
        if isinstance(message, Order):
            self._order, self._times_ns = message, []
            return [] if message.period_s else [self._ask()]
        # A node that has just come may be told twice.
        if isinstance(message, NodeUp) and message.node == SERVER and not self._configured:
            self._configured = True
            return [self._configure()]
        if isinstance(message, EpisodeReady):
            tell("ready")
        return []

    def _configure(self) -> EpisodeConfigure:
        return EpisodeConfigure(
            header=EPISODE,
            task="lid",
            robot="abstract",
            policy="still",
            seed=0,
            # Nothing is dropped, as by the other two.
            mode="lockstep",
            nodes={"sim": CELL, "policy": SERVER},
        )

    def _pass_time(self) -> list[AnyMessage]:
        if self._asked_ns is not None:
            is_silent = time.perf_counter_ns() - self._asked_ns > RESEND_NS * self._tries
            self._tries += is_silent
            return [self._make_frame()] if is_silent else []
        is_due = self._order.period_s > 0 and len(self._times_ns) < self._order.count
        return [self._ask()] if is_due else []

    def _ask(self) -> StereoFrame:
        self._step += 10
        self._tries = 1
        self._asked_ns = time.perf_counter_ns()
        return self._make_frame()

    def _make_frame(self) -> StereoFrame:
        return StereoFrame(
            header=EPISODE.at(self._step, 0.01 * self._step),
            camera="t265",
            width=128,
            height=128,
            left=self._left,
            right=self._right,
            due_step=-1,
        )

    def _take(self, action: PolicyAction) -> list[AnyMessage]:
        arrived_ns = time.perf_counter_ns()
        numbers = {len(step.translation_m) + len(step.rotation_rad) + 1 for step in action.steps}
        is_whole = len(action.steps) == self._steps and numbers == {ACTION_NUMBERS}
        if action.for_step < self._step or self._asked_ns is None:
            return []  # asked twice, answered twice
        if action.for_step > self._step or not is_whole:
            raise SystemExit(f"wrong answer: {action}")
        self._times_ns.append(arrived_ns - self._asked_ns)
        self._asked_ns = None
        if len(self._times_ns) == self._order.count:
            return [Measured(self._times_ns)]
        return [] if self._order.period_s else [self._ask()]


def listen_for_orders(host: Host, stop: threading.Event) -> None:
    """Hand orders in until standard input ends."""

    def listen() -> None:
        for count, period_s in read_orders():
            host.inbox.put_event(Order(count, period_s))
        stop.set()

    threading.Thread(target=listen, name="orders", daemon=True).start()


def tell_times(message: LocalMessage) -> None:
    """Print what was measured."""
    if isinstance(message, Measured):
        tell(message.times_ns)


def main() -> int:
    """Serve or ask."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("role", choices=("serve", "ask"))
    add_arguments(parser)
    args = parser.parse_args()
    settings = BusSettings(endpoint=f"tcp/127.0.0.1:{args.port}", namespace="versus")
    if args.role == "serve":
        still = functools.partial(Still, steps=args.steps)
        run_process(PolicyReactor(node=SERVER, policies={"still": still}), settings, node=SERVER)
    else:
        asker = Asker(steps=args.steps)
        run_process(asker, settings, node=CELL, sink=tell_times, on_host=listen_for_orders)
    return 0


if __name__ == "__main__":
    sys.exit(main())
