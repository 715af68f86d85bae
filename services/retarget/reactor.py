"""The retargeting service: one node that serves many cells and several robots."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from common.errors import LegatoError, UnknownName
from common.messages import (
    EpisodeAbort,
    EpisodeConfigure,
    EpisodeReady,
    Header,
    Message,
    PolicyAction,
    Problem,
    RetargetStatus,
    RobotState,
)
from common.metrics import Sample
from common.robots import RobotSpec, load_robot
from common.safety import ForeignCounts, SingleWriter
from common.service import AnyMessage, Reactor
from common.tasks import Task, load_task
from services.retarget.episode import RetargetEpisode
from services.retarget.measured import Measured
from services.retarget.retargeter import IdentityRetargeter, Retargeter
from services.retarget.robot_model import RobotModel
from services.retarget.whole_body import WholeBodyRetargeter


class RetargetReactor(Reactor):
    """Answers every `RobotState` of its cells with a `RobotCommand`, and every tenth with a status.

    An episode starts with its first state: `EpisodeStart` comes from another node than the states
    and may arrive after them.

    Args:
        node: This node's name, as in `EpisodeConfigure.nodes`.
        robots: Robots it serves.

    Raises:
        UnknownName: There is no such robot.
        BadRobotFile: A robot.toml is not valid.
    """

    kind = "retarget"
    inputs = (EpisodeConfigure, EpisodeAbort, RobotState, PolicyAction)
    packages = ("numpy", "mujoco-core", "pin", "piqp")

    def __init__(self, *, node: str, robots: Sequence[str]) -> None:
        self._node = node
        self._specs = {name: load_robot(name) for name in robots}
        self._models: dict[str, RobotModel] = {}
        self._episodes: dict[str, RetargetEpisode] = {}
        self._measured = Measured(self._specs)
        self._foreign = ForeignCounts(RobotState, PolicyAction)

    def offers(self) -> Mapping[str, list[str]]:
        """The robots it serves."""
        return {"robots": sorted(self._specs)}

    def serves(self, cell: str) -> bool:
        """Whether the cell's current episode uses this node."""
        return cell in self._episodes

    def handle(self, messages: Sequence[AnyMessage]) -> Iterable[Message]:
        """Take what is waiting, in order."""
        answers: list[Message] = []
        for message in messages:
            if isinstance(message, RobotState | PolicyAction | EpisodeAbort):
                answers += self._pass_on(message)
            elif isinstance(message, EpisodeConfigure):
                answers += self._configure(message)
        return answers

    def measure(
        self, given: Sequence[AnyMessage], returned: Sequence[AnyMessage], began_ns: int
    ) -> Iterable[Sample]:
        """Solve times and errors of the hand, every tenth tick for ten ticks."""
        del given, began_ns
        for message in returned:
            if type(message) is RetargetStatus:
                episode = self._episodes.get(message.header.cell)
                if episode is not None:
                    yield from self._measured.add(message, episode.configure.robot)

    def levels(self) -> Iterable[Sample]:
        """Ticks at a limit, ticks without a solution, and messages of foreign nodes."""
        yield from self._measured.levels()
        yield from self._foreign.levels()

    def _pass_on(self, message: RobotState | PolicyAction | EpisodeAbort) -> list[Message]:
        episode = self._episodes.get(message.header.cell)
        if episode is None or episode.epoch != message.header.epoch:
            return []
        if isinstance(message, EpisodeAbort):
            del self._episodes[message.header.cell]
            return []
        if not episode.writer.accepts(message):
            return []
        if isinstance(message, RobotState):
            return episode.take_state(message)
        return episode.take_action(message)

    def _configure(self, configure: EpisodeConfigure) -> list[Message]:
        cell = configure.header.cell
        current = self._episodes.get(cell)
        problem = None
        # Asked again for the episode it already has, it must not start over.
        if current is None or current.epoch != configure.header.epoch:
            self._episodes.pop(cell, None)
            if configure.nodes.get(self.kind) != self._node:
                return []
            try:
                self._episodes[cell] = self._prepare(configure)
            except LegatoError as error:
                problem = Problem(**error.describe())
        header = Header(cell=cell, episode=configure.header.episode, epoch=configure.header.epoch)
        return [EpisodeReady(header=header, node=self._node, kind=self.kind, problem=problem)]

    def _prepare(self, configure: EpisodeConfigure) -> RetargetEpisode:
        spec = self._specs.get(configure.robot)
        if spec is None:
            raise UnknownName("robot", configure.robot, sorted(self._specs))
        task = load_task(configure.task)
        writer = SingleWriter(configure, self._foreign)
        return RetargetEpisode(configure, spec, self._make_retargeter(spec, task), writer)

    def _make_retargeter(self, spec: RobotSpec, task: Task) -> Retargeter:
        if spec.kind == "free_hand":
            return IdentityRetargeter()
        if spec.name not in self._models:
            self._models[spec.name] = RobotModel(spec)
        return WholeBodyRetargeter(self._models[spec.name], task.obstacles)
