"""The simulation as a reactor: it owns one cell and runs one episode at a time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from common.calibration import load_calibration
from common.errors import InvalidValue, LegatoError
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
    Tick,
)
from common.metrics import Sample
from common.metrics.table import ACTION_AGE, COMMAND_AGE
from common.robots import list_robots, load_robot
from common.service import AnyMessage, Reactor
from common.tasks import list_tasks, load_task
from services.sim.camera import RANDOMISED, Sensor, StereoCamera, warm_up, warm_up_meshes
from services.sim.counts import Counts
from services.sim.dress import dress
from services.sim.episode import Episode
from services.sim.world import TOOL_SITE, World

_TAKE_PART = {"sim", "retarget", "gripper", "policy"}
"""Kinds of nodes that every episode has: reasons name them."""
_ANSWERS = (RobotCommand, MotorCommand, RetargetStatus, PolicyAction)


class SimReactor(Reactor):
    """Owner of a simulated cell.

    Args:
        node: Its name, which is the cell's name too.
        meshes: Folder of the meshes that pictures of key moments show; robots that have none are
            drawn from primitives, as all are without it.
    """

    kind = "sim"
    inputs = (EpisodeConfigure, EpisodeStart, EpisodeAbort, *_ANSWERS)
    packages = ("mujoco-core", "numba", "numpy")

    def __init__(self, *, node: str, meshes: Path | None = None) -> None:
        # Ready means ready: no episode may wait for a compiler.
        warm_up()
        if meshes is not None:
            warm_up_meshes()
        self._meshes = meshes
        self.node = node
        self._episode: Episode | None = None
        self._running = False
        self._counts = Counts()

    def offers(self) -> dict[str, list[str]]:
        """Its cell, and what it can simulate."""
        return {"cells": [self.node], "tasks": list_tasks(), "robots": list_robots()}

    @property
    def owned_cell(self) -> str | None:
        """The cell of this process."""
        return self.node

    @property
    def tick_period_s(self) -> float:
        """Fine while it paces an episode, coarse otherwise."""
        if self._episode is not None and self._episode.realtime and self._running:
            return 0.002
        return 0.1

    def handle(self, messages: Sequence[AnyMessage]) -> Iterable[AnyMessage]:
        """Take answers, control messages and time; return the next ticks."""
        outputs: list[AnyMessage] = []
        for message in messages:
            outputs += self._handle_one(message)
            if self._episode is not None and self._episode.over:
                self._episode = None
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
        return self._counts.levels()

    def _handle_one(self, message: AnyMessage) -> list[Message]:
        # Answers first: there are hundreds of them a second.
        if self._running and self._episode is not None and isinstance(message, _ANSWERS):
            return self._episode.take(message)
        if isinstance(message, EpisodeConfigure):
            return [self._prepare(message)]
        if self._episode is None:
            return []
        if isinstance(message, EpisodeStart):
            if self._running:
                return []
            self._running = True
            return self._episode.start()
        if isinstance(message, EpisodeAbort):
            self._episode = None
            return []
        if self._running and isinstance(message, Tick):
            return self._episode.pass_time(message.t_mono_ns)
        return []

    def _prepare(self, configure: EpisodeConfigure) -> EpisodeReady:
        """Build the world; an error in a name or file becomes the answer, not a crash."""
        self._episode = None
        self._running = False
        problem = None
        try:
            if missing := _TAKE_PART - configure.nodes.keys():
                named = ", ".join(sorted(configure.nodes)) or "none"
                expected = f"also {', '.join(sorted(missing))}"
                raise InvalidValue("EpisodeConfigure.nodes", named, expected)
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
            self._episode = Episode(configure, world, camera, calibration, sensor, skin)
            self._counts.follow(self._episode.counts)
        except LegatoError as error:
            problem = Problem(**error.describe())
        return EpisodeReady(
            header=configure.header, node=self.node, kind=self.kind, problem=problem
        )
