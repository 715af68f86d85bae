"""The policy service as a reactor: any number of cells, each with its own policy and state."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from common.errors import LegatoError
from common.messages import (
    EpisodeAbort,
    EpisodeConfigure,
    EpisodeReady,
    GroundTruth,
    Header,
    Message,
    PolicyAction,
    Problem,
    StereoFrame,
)
from common.service import AnyMessage, Reactor
from services.policy.policy import Observation, Policy
from services.policy.registry import BUILT_IN, make_policy


@dataclass
class _Cell:
    """State of one cell's policy in one episode."""

    policy: Policy
    frame: StereoFrame | None = None
    truth: GroundTruth | None = None
    last_step: int = -1
    last_reply: PolicyAction | None = None


class PolicyReactor(Reactor):
    """Serves policies.

    Args:
        node: Its name.
        policies: Name -> maker of a policy.
    """

    kind = "policy"
    inputs = (EpisodeConfigure, EpisodeAbort, StereoFrame, GroundTruth)
    packages = ("numpy",)

    def __init__(
        self, *, node: str, policies: Mapping[str, Callable[[], Policy]] = BUILT_IN
    ) -> None:
        self.node = node
        self._policies = policies
        self._cells: dict[str, _Cell] = {}

    def offers(self) -> dict[str, list[str]]:
        """Names of the policies."""
        return {"policies": sorted(self._policies)}

    def serves(self, cell: str) -> bool:
        """Only cells whose episode uses this service."""
        return cell in self._cells

    def handle(self, messages: Sequence[AnyMessage]) -> Iterable[AnyMessage]:
        """Take frames and truth, return actions."""
        outputs: list[AnyMessage] = []
        for message in messages:
            if isinstance(message, EpisodeConfigure):
                outputs += self._prepare(message)
            elif isinstance(message, EpisodeAbort):
                self._cells.pop(message.header.cell, None)
            elif isinstance(message, StereoFrame | GroundTruth):
                outputs += self._observe(message)
        return outputs

    def _prepare(self, configure: EpisodeConfigure) -> list[Message]:
        self._cells.pop(configure.header.cell, None)
        if configure.nodes.get(self.kind) != self.node:
            return []
        problem = None
        try:
            policy = make_policy(configure.policy, self._policies)
            policy.reset(seed=configure.seed, task=configure.task)
            self._cells[configure.header.cell] = _Cell(policy)
        except LegatoError as error:
            problem = Problem(**error.describe())
        return [
            EpisodeReady(header=configure.header, node=self.node, kind=self.kind, problem=problem)
        ]

    def _observe(self, message: StereoFrame | GroundTruth) -> list[Message]:
        cell = self._cells.get(message.header.cell)
        if cell is None or message.header.step < cell.last_step:
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
        cell.last_step = frame.header.step
        cell.last_reply = self._act(cell.policy, Observation(frame, truth))
        return [cell.last_reply]

    def _act(self, policy: Policy, observation: Observation) -> PolicyAction:
        asked = observation.frame.header
        started = time.perf_counter()
        steps = policy.act(observation)
        inference_s = time.perf_counter() - started
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
            steps=steps,
            inference_s=inference_s,
        )
