"""The simulation as a reactor: it owns one cell and runs one episode at a time."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from pathlib import Path

from common.calibration import load_calibration
from common.errors import EmergencyStopped, LegatoError
from common.messages import (
    EpisodeAbort,
    EpisodeConfigure,
    EpisodeReady,
    EpisodeResult,
    EpisodeStart,
    Message,
    MotorCommand,
    PolicyAction,
    Problem,
    RetargetStatus,
    RobotCommand,
    SafetyReset,
    SafetyStop,
    Tick,
)
from common.metrics import Sample
from common.metrics.table import ACTION_AGE, COMMAND_AGE
from common.robots import list_robots, load_robot
from common.safety import ForeignCounts, SafetyLatch, SingleWriter
from common.service import AnyMessage, Reactor
from common.tasks import list_tasks, load_task
from services.sim.body import GuardedBody
from services.sim.camera import RANDOMISED, Sensor, StereoCamera, warm_up, warm_up_meshes
from services.sim.counts import Counts
from services.sim.dress import dress
from services.sim.episode import Episode
from services.sim.hold import Hold
from services.sim.safety_report import SafetyReport
from services.sim.tool_log import ToolLog
from services.sim.world import TOOL_SITE, World

log = logging.getLogger(__name__)

_ANSWERS = (RobotCommand, MotorCommand, RetargetStatus, PolicyAction)


class SimReactor(Reactor):
    """Owner of a simulated cell.

    Args:
        node: Its name, which is the cell's name too.
        meshes: Folder of the meshes that pictures of key moments show; robots that have none are
            drawn from primitives, as all are without it.
        tool_log: Takes the tool's pose after every tick.
    """

    kind = "sim"
    inputs = (
        *(SafetyStop, SafetyReset),
        *(EpisodeConfigure, EpisodeStart, EpisodeAbort),
        *_ANSWERS,
    )
    packages = ("mujoco-core", "numba", "numpy")

    def __init__(
        self, *, node: str, meshes: Path | None = None, tool_log: ToolLog | None = None
    ) -> None:
        self._log = tool_log
        # Ready means ready: no episode may wait for a compiler.
        warm_up()
        if meshes is not None:
            warm_up_meshes()
        self._meshes = meshes
        self.node = node
        self._latch = SafetyLatch()
        self._report = SafetyReport(node, self._latch)
        self._episode: Episode | None = None
        self._running = False
        self._counts = Counts()
        self._foreign = ForeignCounts(*_ANSWERS)
        self._hold: Hold | None = None

    def offers(self) -> dict[str, list[str]]:
        """Its cell, and what it can simulate."""
        return {"cells": [self.node], "tasks": list_tasks(), "robots": list_robots()}

    @property
    def owned_cell(self) -> str | None:
        """The cell of this process."""
        return self.node

    @property
    def tick_period_s(self) -> float:
        """Fine while it paces a world, coarse otherwise."""
        if self._hold is not None:
            return 0.005
        if self._episode is not None and self._episode.realtime and self._running:
            return 0.002
        return 0.1

    def handle(self, messages: Sequence[AnyMessage]) -> Iterable[AnyMessage]:
        """Take answers, control messages and time; return the next ticks."""
        outputs: list[AnyMessage] = []
        for message in messages:
            news = self._handle_one(message)
            episode = self._episode
            if episode is not None and episode.over:
                self._retire(episode)
            # Before the result: whoever hears that an episode was aborted knows why.
            outputs += self._report.update(message, episode, self._hold)
            outputs += news
        return outputs

    def measure(
        self, given: Sequence[AnyMessage], returned: Sequence[AnyMessage], began_ns: int
    ) -> Iterable[Sample]:
        """Ages of the answers; both stamps are of this process's clock."""
        for message in given:
            if type(message) is RobotCommand:
                yield Sample(COMMAND_AGE, (began_ns - message.request_t_mono_ns) * 1e-9)
            elif type(message) is PolicyAction:
                yield Sample(ACTION_AGE, (began_ns - message.request_t_mono_ns) * 1e-9)
        for message in returned:
            if type(message) is EpisodeResult:
                self._counts.end(message.result.outcome)

    def levels(self) -> Iterable[Sample]:
        """What was counted over all episodes."""
        yield from self._counts.levels()
        yield from self._latch.levels()
        yield from self._foreign.levels()

    def _handle_one(self, message: AnyMessage) -> list[Message]:
        # Answers first: there are hundreds of them a second.
        if self._running and self._episode is not None and isinstance(message, _ANSWERS):
            return self._episode.take(message)
        if isinstance(message, Tick):
            return self._pass_time(message.t_mono_ns)
        if isinstance(message, SafetyStop):
            return self._stop(message)
        if isinstance(message, SafetyReset):
            self._reset(message)
        elif isinstance(message, EpisodeConfigure):
            return [self._prepare(message)]
        elif isinstance(message, EpisodeStart):
            return self._start()
        elif isinstance(message, EpisodeAbort) and self._episode is not None:
            self._retire(self._episode)
        return []

    def _start(self) -> list[Message]:
        if self._episode is None or self._running:
            return []
        self._running = True
        return self._episode.start()

    def _pass_time(self, now_ns: int) -> list[Message]:
        if self._hold is not None:
            self._hold.pass_time(now_ns)
        if self._running and self._episode is not None:
            return self._episode.pass_time(now_ns)
        return []

    def _stop(self, stop: SafetyStop) -> list[Message]:
        """Latch an emergency stop, whatever is going on; a running episode ends with it."""
        fault = EmergencyStopped(self.node, stop.by, stop.reason)
        if not self._latch.emergency:
            log.warning("emergency stop", extra={"cell": self.node, **fault.describe()})
        self._latch.engage(fault)
        episode = self._episode
        if episode is None:
            return []
        if self._running:
            return episode.stop(fault)
        self._episode = None
        return []

    def _reset(self, reset: SafetyReset) -> None:
        if self._hold is not None and self._hold.body.guard.status != "stopped":
            log.warning("not reset while the robot moves", extra={"cell": self.node})
            return
        log.info("safety reset", extra={"cell": self.node, "by": reset.by})
        self._latch.reset()

    def _retire(self, episode: Episode) -> None:
        """Let an episode go. A robot in real time does not end with it: it is brought to rest."""
        if self._running and episode.realtime and episode.body.world.is_bounded():
            self._hold = Hold(episode.body, episode.pacer)
        self._episode = None
        self._running = False

    def _prepare(self, configure: EpisodeConfigure) -> EpisodeReady:
        """Build the world; an error in a name or file becomes the answer, not a crash."""
        self._episode = None
        self._running = False
        self._hold = None
        problem = None
        try:
            self._latch.open_episode()
            writer = SingleWriter(configure, self._foreign)
            world = World(
                task=load_task(configure.task),
                robot=load_robot(configure.robot),
                seed=configure.seed,
            )
            calibration = load_calibration(configure.camera)
            camera = StereoCamera(
                world.model,
                calibration,
                tool_site=TOOL_SITE,
                full_grid=configure.full_grid,
            )
            sensor = None
            if configure.randomise_camera:
                sensor = Sensor(calibration, RANDOMISED, seed=configure.seed)
            skin = None
            if configure.pictures and self._meshes and world.robot.meshes:
                skin = dress(world, self._meshes)
            epoch = configure.header.epoch
            body = GuardedBody(world, self._latch, epoch=epoch, log=self._log)
            self._episode = Episode(configure, writer, body, camera, calibration, sensor, skin)
            self._counts.follow(self._episode.counts)
        except LegatoError as error:
            problem = Problem(**error.describe())
        return EpisodeReady(
            header=configure.header, node=self.node, kind=self.kind, problem=problem
        )
