"""One try at a trial on one cell."""

from __future__ import annotations

from dataclasses import dataclass, field

from common.api import EvaluationRequest
from common.lease import TICK_LEASES
from common.messages import EpisodeAbort, EpisodeConfigure, EpisodeStart, Header
from services.control.events import TrialSpec


@dataclass
class Attempt:
    """The state between handing a trial to a cell and its end.

    Args:
        trial: The trial.
        nodes: Kind -> node of those that take part.
        epoch: Epoch of the cell; messages of another one do not count.
        since_ns: When it was configured, later when the owner of the cell last gave a sign.
        unready: Kinds that have not answered the configuration.
        running: Whether the episode was started.
        lost: Participants that were lost, as (kind, node).
    """

    trial: TrialSpec
    nodes: dict[str, str]
    epoch: int
    since_ns: int
    unready: set[str] = field(init=False)
    running: bool = False
    lost: list[tuple[str, str]] = field(default_factory=list[tuple[str, str]])

    def __post_init__(self) -> None:
        self.unready = set(self.nodes)

    @property
    def cell(self) -> str:
        """The cell is named as the simulation that owns it."""
        return self.nodes["sim"]

    @property
    def number(self) -> int:
        """1 for the first attempt."""
        return self.trial.spent + 1

    @property
    def header(self) -> Header:
        """Header of every message about it."""
        trial = self.trial
        return Header(
            cell=self.cell,
            episode=f"{trial.evaluation}.{trial.id}.{self.number}",
            epoch=self.epoch,
        )

    def configure(self, request: EvaluationRequest, *, lease_s: float) -> EpisodeConfigure:
        """The message that prepares it, where a silent node is believed to be alive for a lease."""
        return EpisodeConfigure(
            header=self.header,
            task=self.trial.task,
            robot=self.trial.robot,
            policy=self.trial.policy,
            seed=self.trial.seed,
            mode=request.mode,
            nodes=self.nodes,
            node_deadline_s=TICK_LEASES * lease_s,
            camera=request.camera,
            action_latency_s=request.action_latency_s,
            tracking_lag_s=request.tracking_lag_s,
            randomise_camera=request.randomise_camera,
            full_grid=request.full_grid,
            pictures=request.pictures,
        )

    def start(self, now_ns: int) -> EpisodeStart:
        """The message that starts it."""
        self.running = True
        self.since_ns = now_ns
        return EpisodeStart(header=self.header)

    def heard(self, now_ns: int) -> None:
        """The cell's owner gave a sign of life; only an answer counts before the start."""
        if self.running:
            self.since_ns = now_ns

    def abort(self, reason: str) -> EpisodeAbort:
        """The message that stops it."""
        return EpisodeAbort(header=self.header, reason=reason)
