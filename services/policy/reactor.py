"""The policy service as a reactor: any number of cells, each with its own policy and state."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from common.errors import InvalidValue, LegatoError, UnknownName
from common.messages import (
    CheckpointDescription,
    EpisodeAbort,
    EpisodeConfigure,
    EpisodeReady,
    GroundTruth,
    Header,
    Message,
    PolicyAction,
    PolicyLoad,
    PolicyLoaded,
    Problem,
    StereoFrame,
)
from common.metrics import Sample
from common.metrics.table import BATCH, INFERENCE, OBSERVATION_AGE
from common.safety import ForeignCounts, SingleWriter
from common.service import AnyMessage, Reactor
from services.policy.batches import Acted, Pass, act_all
from services.policy.policy import Observation, Policy
from services.policy.registry import BUILT_IN
from services.policy.serving.library import Library

OLDEST_OBSERVATION_S = 60.0
"""An older frame was stamped by the clock of another host."""


@dataclass
class _Cell:
    """State of one cell's policy in one episode."""

    policy: Policy
    configure: EpisodeConfigure
    writer: SingleWriter
    frame: StereoFrame | None = None
    truth: GroundTruth | None = None
    last_step: int = -1
    last_reply: PolicyAction | None = None


class PolicyReactor(Reactor):
    """Serves policies.

    Frames of several cells that wait together go through a network together.

    Args:
        node: Its name.
        policies: Name -> maker of a policy that comes with the code.
        library: Learned policies.
    """

    kind = "policy"
    inputs = (EpisodeConfigure, EpisodeAbort, PolicyLoad, StereoFrame, GroundTruth)
    packages = ("numpy", "onnxruntime")

    def __init__(
        self,
        *,
        node: str,
        policies: Mapping[str, Callable[[], Policy]] = BUILT_IN,
        library: Library | None = None,
    ) -> None:
        self.node = node
        self._policies = policies
        self._library = Library() if library is None else library
        self._cells: dict[str, _Cell] = {}
        self._due: list[tuple[_Cell, Observation]] = []
        self._passes: list[Pass] = []
        self._foreign = ForeignCounts(StereoFrame, GroundTruth)

    def offers(self) -> dict[str, list[str]]:
        """Names of the policies."""
        return {"policies": sorted({*self._policies, *self._library.names()})}

    def checkpoints(self) -> Mapping[str, CheckpointDescription]:
        """The learned ones."""
        return self._library.describe()

    def serves(self, cell: str) -> bool:
        """Only cells whose episode uses this service."""
        return cell in self._cells

    def handle(self, messages: Sequence[AnyMessage]) -> Iterable[AnyMessage]:
        """Take frames and truth, return actions."""
        outputs: list[AnyMessage] = []
        self._passes.clear()
        for message in messages:
            if isinstance(message, StereoFrame | GroundTruth):
                outputs += self._observe(message)
                continue
            # What was observed before belongs to the episodes before.
            outputs += self._act()
            if isinstance(message, EpisodeConfigure):
                outputs += self._prepare(message)
            elif isinstance(message, EpisodeAbort):
                self._cells.pop(message.header.cell, None)
            elif isinstance(message, PolicyLoad) and message.node == self.node:
                outputs.append(self._load(message))
        return [*outputs, *self._act()]

    def measure(
        self, given: Sequence[AnyMessage], returned: Sequence[AnyMessage], began_ns: int
    ) -> Iterable[Sample]:
        """Ages of the frames, and the passes of the last `handle`."""
        del returned
        for message in given:
            if type(message) is StereoFrame:
                age_s = (began_ns - message.header.t_mono_ns) * 1e-9
                # The clocks of two hosts have nothing in common.
                if 0.0 <= age_s < OLDEST_OBSERVATION_S:
                    yield Sample(OBSERVATION_AGE, age_s)
        for each in self._passes:
            yield Sample(INFERENCE, each.inference_s)
            yield Sample(BATCH, each.cells)

    def levels(self) -> Iterable[Sample]:
        """Messages of foreign nodes."""
        return self._foreign.levels()

    def _prepare(self, configure: EpisodeConfigure) -> list[Message]:
        self._cells.pop(configure.header.cell, None)
        if configure.nodes.get(self.kind) != self.node:
            return []
        problem = None
        try:
            writer = SingleWriter(configure, self._foreign)
            policy = self._make(configure.policy)
            policy.reset(seed=configure.seed, task=configure.task)
            self._cells[configure.header.cell] = _Cell(policy, configure, writer)
        except LegatoError as error:
            problem = error
        return [self._answer(configure, problem)]

    def _make(self, name: str) -> Policy:
        if name in self._library:
            return self._library.make_policy(name)
        if name in self._policies:
            return self._policies[name]()
        raise UnknownName("policy", name, self.offers()["policies"])

    def _answer(self, configure: EpisodeConfigure, problem: LegatoError | None) -> EpisodeReady:
        return EpisodeReady(
            header=configure.header,
            node=self.node,
            kind=self.kind,
            problem=None if problem is None else Problem(**problem.describe()),
        )

    def _load(self, asked: PolicyLoad) -> PolicyLoaded:
        """Load a checkpoint; running episodes keep what they have."""
        problem = None
        try:
            if asked.policy in self._policies:
                expected = f"a name other than {', '.join(sorted(self._policies))}"
                raise InvalidValue("policy", asked.policy, expected)
            self._library.load(asked.policy, asked.folder)
        except LegatoError as error:
            problem = Problem(**error.describe())
        return PolicyLoaded(
            header=Header(),
            request=asked.request,
            node=self.node,
            policy=asked.policy,
            checkpoint=None if problem else self.checkpoints()[asked.policy],
            problem=problem,
        )

    def _observe(self, message: StereoFrame | GroundTruth) -> list[Message]:
        """Note what a cell sees; once it sees everything, its policy is due."""
        cell = self._cells.get(message.header.cell)
        if cell is None or not cell.writer.accepts(message):
            return []
        if message.header.step < cell.last_step:
            return []
        if message.header.step == cell.last_step:
            # Asked again: the same answer, and only once for frame and truth.
            again = cell.last_reply if isinstance(message, StereoFrame) else None
            return [again] if again is not None else []
        if isinstance(message, StereoFrame):
            cell.frame = message
        else:
            cell.truth = message
        frame, truth = cell.frame, cell.truth if cell.policy.needs_truth else None
        if frame is None or frame.header.step <= cell.last_step:
            return []
        if cell.policy.needs_truth and (truth is None or truth.header.step != frame.header.step):
            return []
        cell.last_step, cell.last_reply = frame.header.step, None
        self._due.append((cell, Observation(frame, truth)))
        return []

    def _act(self) -> list[Message]:
        """Let the policies act that are due, in the order in which they became so."""
        due, self._due = self._due, []
        done = act_all([(cell.policy, observation) for cell, observation in due])
        self._passes += dict.fromkeys(x.made_by for x in done if isinstance(x, Acted))
        outputs: list[Message] = []
        for (cell, observation), result in zip(due, done, strict=True):
            if isinstance(result, LegatoError):
                # Not ready after all: whoever runs the episode ends it with this reason.
                self._cells.pop(observation.frame.header.cell)
                outputs.append(self._answer(cell.configure, result))
            else:
                cell.last_reply = _reply(observation.frame, result)
                outputs.append(cell.last_reply)
        return outputs


def _reply(frame: StereoFrame, acted: Acted) -> PolicyAction:
    asked = frame.header
    return PolicyAction(
        header=Header(
            cell=asked.cell,
            episode=asked.episode,
            epoch=asked.epoch,
            step=asked.step,
            t_sim_s=asked.t_sim_s,
        ),
        for_step=asked.step,
        request_t_mono_ns=asked.t_mono_ns,
        steps=acted.steps,
        inference_s=acted.made_by.inference_s,
    )
