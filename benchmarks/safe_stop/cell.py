"""A cell in real time whose processes are killed and stopped: no control plane helps it."""

from __future__ import annotations

import itertools
import os
import signal
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from benchmarks.safe_stop.record import Row, Stop, find_fault, measure_stop, read_rows
from client.deployment import Deployment, ProcessSpec, find_free_ports
from client.supervisor import Supervisor
from common.bus import Bus, BusSettings, Inbox, Received, decode, open_session
from common.clock import TICK_S
from common.messages import EpisodeAbort, EpisodeConfigure, EpisodeReady, EpisodeStart, Header
from common.topics import topic_of

Fault = Literal[
    "policy killed", "policy stopped", "retarget killed", "retarget stopped", "router killed"
]
FAULTS: tuple[Fault, ...] = (
    *("policy killed", "policy stopped"),
    *("retarget killed", "retarget stopped", "router killed"),
)

CELL = "sim-0"
MOVING_M_S = 0.15
"""The expert's ways in free space are about twice as fast at their fastest."""
WATCHED_S = 1.3
WAIT_S = 60.0
ATTEMPTS = 20
"""A busy machine stops a robot before the fault does: a command that comes late is enough."""


class NeverMoved(Exception):
    """The robot was stopped, by a late process say, before the fault could be made."""


@dataclass(frozen=True)
class Measured:
    """One fault.

    Args:
        stop: What it did.
        attempts: Episodes it took until the robot moved when the fault came.
    """

    stop: Stop
    attempts: int


class FaultyCell:
    """Runs episodes and breaks one process in the middle of each.

    Args:
        supervisor: Starts what was killed again.
        bus: To configure episodes.
        log: The simulation's tool log.
    """

    def __init__(self, supervisor: Supervisor, bus: Bus, log: Path) -> None:
        self._supervisor = supervisor
        self._bus = bus
        self._log = log
        self._epochs = itertools.count(1)
        self._offset = 0
        self._inbox = Inbox()
        bus.subscribe(topic_of(EpisodeReady), self._inbox)

    def measure(self, robot: str, fault: Fault) -> Measured:
        """Move a robot, break a process, and watch the tool.

        Raises:
            NeverMoved: In none of several episodes did the robot get to move.
        """
        for attempt in range(1, ATTEMPTS + 1):
            epoch = next(self._epochs)
            header = Header(cell=CELL, episode=f"{robot}.{epoch}", epoch=epoch, source="bench")
            self._start(robot, header)
            try:
                self._wait_until_moving(epoch)
            except NeverMoved:
                self._publish(EpisodeAbort(header=header, reason="never moved"))
                continue
            fault_ns = time.monotonic_ns()
            pid, node = self._break(robot, fault)
            rows = self._watch(epoch, fault_ns)
            if fault.endswith("stopped"):
                os.kill(pid, signal.SIGKILL)
            self._wait_for_another(node, pid)
            self._publish(EpisodeAbort(header=header, reason=fault))
            stop = measure_stop([row.pose for row in rows], find_fault(rows, fault_ns))
            return Measured(stop, attempt)
        raise NeverMoved(f"{robot} was stopped {ATTEMPTS} times before the fault {fault}")

    def _start(self, robot: str, header: Header) -> None:
        nodes = {
            "sim": CELL,
            "retarget": f"retarget-{robot}",
            "gripper": "gripper",
            "policy": "policy",
        }
        configure = EpisodeConfigure(
            header=header,
            task="lid",
            robot=robot,
            policy="expert",
            seed=3,
            mode="realtime",
            nodes=nodes,
        )
        waiting = set(nodes)
        deadline_s = time.monotonic() + WAIT_S
        while waiting:
            if time.monotonic() > deadline_s:
                raise TimeoutError(f"not ready: {', '.join(sorted(waiting))}")
            # Said again: a process that has just started hears only what comes now.
            self._publish(configure)
            self._inbox.wait(1.0)
            for ready in self._take_ready():
                if ready.header.epoch == header.epoch:
                    if ready.problem is not None:
                        raise RuntimeError(ready.problem.happened)
                    waiting.discard(ready.kind)
        self._offset = self._log.stat().st_size
        self._publish(EpisodeStart(header=header))

    def _take_ready(self) -> Iterator[EpisodeReady]:
        _, received = self._inbox.drain()
        for item in received:
            if isinstance(item, Received):
                message = decode(item.topic, item.encoding, item.payload)
                if isinstance(message, EpisodeReady):
                    yield message

    def _wait_until_moving(self, epoch: int) -> None:
        deadline_s = time.monotonic() + WAIT_S
        while time.monotonic() < deadline_s:
            rows = read_rows(self._log, epoch=epoch, offset=self._offset)
            if rows and rows[-1].status != "running":
                raise NeverMoved
            if len(rows) > 5:
                way_m = sum((a - b) ** 2 for a, b in zip(*_ends(rows[-5:]), strict=True)) ** 0.5
                if way_m > MOVING_M_S * 4 * TICK_S:
                    return
            time.sleep(0.01)
        raise TimeoutError("the robot does not move")

    def _break(self, robot: str, fault: Fault) -> tuple[int, str]:
        kind, how = fault.split()
        node = f"retarget-{robot}" if kind == "retarget" else kind
        pid = self._supervisor.pids[node]
        os.kill(pid, signal.SIGKILL if how == "killed" else signal.SIGSTOP)
        return pid, node

    def _watch(self, epoch: int, fault_ns: int) -> list[Row]:
        deadline_s = time.monotonic() + WAIT_S
        while time.monotonic() < deadline_s:
            rows = read_rows(self._log, epoch=epoch, offset=self._offset)
            after = [row for row in rows if row.t_mono_ns >= fault_ns]
            if len(after) * TICK_S > WATCHED_S:
                return rows
            time.sleep(0.05)
        raise TimeoutError("the simulation does not go on")

    def _wait_for_another(self, node: str, pid: int) -> None:
        deadline_s = time.monotonic() + WAIT_S
        while self._supervisor.pids.get(node, pid) == pid:
            if time.monotonic() > deadline_s:
                raise TimeoutError(f"{node} was not started again")
            time.sleep(0.02)

    def _publish(self, message: EpisodeConfigure | EpisodeStart | EpisodeAbort) -> None:
        self._bus.publish(message, owner=CELL, mode="realtime")


@contextmanager
def open_cell(folder: Path, robots: Sequence[str]) -> Iterator[FaultyCell]:
    """Start router, simulation, retargeters, gripper and policy; stop them in every case."""
    router_port, rest_port = find_free_ports(2)
    deployment = Deployment(
        robots=tuple(robots),
        rest_port=rest_port,
        router_port=router_port,
        namespace=f"safe-stop-{router_port}",
        data=folder,
    )
    log = folder / "tool.csv"
    specs = [_with_log(spec, log) for spec in deployment.processes() if spec.kind != "control"]
    settings = BusSettings(endpoint=deployment.endpoint, namespace=deployment.namespace)
    with Supervisor(specs, logs=deployment.logs) as supervisor:
        supervisor.start()
        with open_session(settings) as session, Bus(session) as bus:
            yield FaultyCell(supervisor, bus, log)


def _with_log(spec: ProcessSpec, log: Path) -> ProcessSpec:
    if spec.kind != "sim":
        return spec
    return replace(spec, arguments=(*spec.arguments, f"--tool-log={log}"))


def _ends(rows: Sequence[Row]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    return rows[0].pose[:3], rows[-1].pose[:3]
