"""Stand-ins for the nodes of a deployment, as small as the episode protocol allows."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager

from common.api import TaskInfo
from common.bus import Bus, BusSettings, open_session
from common.errors import EmergencyStopped
from common.messages import (
    CheckpointDescription,
    Distribution,
    EpisodeAbort,
    EpisodeConfigure,
    EpisodePicture,
    EpisodeReady,
    EpisodeResult,
    EpisodeStart,
    Header,
    PolicyLoad,
    PolicyLoaded,
    Problem,
    SafetyReset,
    SafetyState,
    SafetyStop,
    StagesReached,
    TrialResult,
    WallTimes,
)
from common.service import AnyMessage, Host, InlineRunner, Reactor
from services.control.catalog import Catalog, Robot
from services.control.scheduler import Scheduler

CATALOG = Catalog(
    robots=tuple(Robot(name, name.title(), 7) for name in ("abstract", "panda", "spot")),
    tasks=(TaskInfo(name="lid", title="Close the lid", time_limit_s=20.0),),
    cameras=("t265", "pinhole"),
)


def make_result(outcome: str = "success", reason: str = "lid closed", *, seed: int = 0):
    """A result as the simulation sends it; the trace depends on the seed alone."""
    spread = Distribution(median=0.01, p95=0.02, p99=0.025, largest=0.03)
    return TrialResult(
        outcome=outcome,
        reason=reason,
        failed_conditions=[],
        ticks=500,
        sim_time_s=5.0,
        wall_time_s=0.5,
        stages=StagesReached(grasped=True, lifted=True, placed=True, released=True),
        goal_distance_m=0.001,
        hand_error_m=spread,
        hand_error_rad=spread,
        hand_scaling_mean=0.99,
        hand_scaling_least=0.5,
        limited_share=0.125,
        solver_failures=1,
        solve_time_s=spread,
        inference_s=spread,
        wall_times=WallTimes(
            physics_s=0.1, camera_s=0.1, waiting_s=0.3, solve_s=0.1, inference_s=0.1
        ),
        held_ticks=0,
        missed_frames=0,
        resends=0,
        trace_sha256=f"{seed:064x}",
    )


def make_picture(header, *, moment: str = "end") -> EpisodePicture:
    return EpisodePicture(
        header=header, moment=moment, view="scene", width=4, height=2, channels=3, pixels=bytes(24)
    )


def make_checkpoint(folder: str) -> CheckpointDescription:
    """A description whose hash follows from the folder."""
    return CheckpointDescription(
        sha256=hashlib.sha256(folder.encode()).hexdigest(),
        folder=folder,
        method="legato",
        tasks=["lid"],
        runtime="none",
        device="cpu",
        decoding="most-likely",
    )


def make_safety_state(cell: str, stopped_by: SafetyStop | None = None) -> SafetyState:
    """What a guard says at rest, perhaps under an emergency stop."""
    problem = None
    if stopped_by is not None:
        error = EmergencyStopped(cell, stopped_by.by, stopped_by.reason)
        problem = Problem(**error.describe())
    return SafetyState(
        header=Header(cell=cell),
        status="stopped",
        fault=problem,
        emergency_stop=stopped_by is not None,
    )


class FakeNode(Reactor):
    """Gets ready for every episode that names it."""

    inputs = (EpisodeConfigure, EpisodeStart, EpisodeAbort)

    def __init__(self, node: str, *, robots: Sequence[str] = (), policies: Sequence[str] = ()):
        self.node = node
        self.problem: Problem | None = None
        self._offers = {"robots": list(robots), "policies": list(policies)}

    def offers(self):
        return {what: names for what, names in self._offers.items() if names}

    def handle(self, messages: Sequence[AnyMessage]) -> Iterable[AnyMessage]:
        for message in messages:
            if isinstance(message, EpisodeConfigure) and message.nodes[self.kind] == self.node:
                yield EpisodeReady(
                    header=message.header, node=self.node, kind=self.kind, problem=self.problem
                )


class FakeRetarget(FakeNode):
    kind = "retarget"


class FakeGripper(FakeNode):
    kind = "gripper"


class FakePolicy(FakeNode):
    """Loads whatever it is told to, but a folder called `broken`; holds its answer on request."""

    kind = "policy"
    inputs = (*FakeNode.inputs, PolicyLoad)

    def __init__(self, node: str, **fields):
        super().__init__(node, **fields)
        self.silent = threading.Event()
        self.loaded: dict[str, CheckpointDescription] = {}

    def offers(self):
        return {"policies": sorted({*self._offers["policies"], *self.loaded})}

    def checkpoints(self):
        return self.loaded

    def handle(self, messages: Sequence[AnyMessage]) -> Iterable[AnyMessage]:
        yield from super().handle(messages)
        for message in messages:
            loads = isinstance(message, PolicyLoad) and message.node == self.node
            if loads and not self.silent.is_set():
                yield self._load(message)

    def _load(self, asked: PolicyLoad) -> PolicyLoaded:
        problem = checkpoint = None
        if asked.folder == "broken":
            problem = Problem(code="E-BROKEN", happened="it broke", expected="e", action="a")
        else:
            checkpoint = self.loaded[asked.policy] = make_checkpoint(asked.folder)
        return PolicyLoaded(
            header=Header(),
            request=asked.request,
            node=self.node,
            policy=asked.policy,
            checkpoint=checkpoint,
            problem=problem,
        )


class FakeSim(FakeNode):
    """Ends an episode at its next tick; while `hold` is set it keeps it running."""

    kind = "sim"
    inputs = (SafetyStop, SafetyReset, *FakeNode.inputs)
    packages = ("numpy",)

    def __init__(self, node: str) -> None:
        super().__init__(node)
        self.hold = threading.Event()
        self.configured: list[EpisodeConfigure] = []
        self.aborted: list[EpisodeAbort] = []
        self.judge: Callable[[EpisodeConfigure], TrialResult] = lambda configure: make_result(
            seed=configure.seed
        )
        self._running: EpisodeConfigure | None = None
        self.deaf = threading.Event()
        """Hears no stop and no reset."""
        self.stopped_by: SafetyStop | None = None

    @property
    def owned_cell(self) -> str:
        return self.node

    @property
    def tick_period_s(self) -> float:
        return 0.005

    def handle(self, messages: Sequence[AnyMessage]) -> Iterable[AnyMessage]:
        for message in messages:
            if isinstance(message, SafetyStop | SafetyReset) and not self.deaf.is_set():
                self.stopped_by = message if isinstance(message, SafetyStop) else None
                yield make_safety_state(self.node, self.stopped_by)
            elif isinstance(message, EpisodeConfigure):
                self.configured.append(message)
                yield from super().handle([message])
            elif isinstance(message, EpisodeStart):
                self._running = self.configured[-1]
            elif isinstance(message, EpisodeAbort):
                self.aborted.append(message)
                self._running = None
        if self._running is not None and not self.hold.is_set():
            configure, self._running = self._running, None
            if configure.pictures:
                yield make_picture(configure.header)
            yield EpisodeResult(header=configure.header, result=self.judge(configure))


def usual_nodes(*, cells: int = 1, robots: Sequence[str] = ("abstract", "panda")) -> list[FakeNode]:
    """A deployment with everything."""
    return [
        *(FakeSim(f"sim-{number}") for number in range(cells)),
        *(FakeRetarget(f"retarget-{robot}", robots=[robot]) for robot in robots),
        FakeGripper("gripper"),
        FakePolicy("policy", policies=["expert", "random"]),
    ]


@contextmanager
def one_process(
    scheduler: Scheduler, nodes: Sequence[FakeNode], sink
) -> Iterator[tuple[InlineRunner, Host]]:
    """Scheduler and nodes on one session without links; give runner and scheduler's host."""
    with open_session(BusSettings(profile="in_process")) as session, Bus(session) as bus:
        host = Host(scheduler, bus, node="control", sink=sink)
        others = [Host(node, bus, node=node.node) for node in nodes]
        runner = InlineRunner([host, *others])
        runner.start()
        yield runner, host
