"""Hands trials to idle cells and follows each attempt to its end."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

from common.aborts import Cause, write_reason
from common.errors import EmergencyStopped
from common.lease import LOCAL_LEASE_S
from common.messages import (
    AskDescription,
    EpisodePicture,
    EpisodeReady,
    EpisodeResult,
    Header,
    LocalMessage,
    Message,
    NodeDescription,
    NodeDown,
    NodeMetrics,
    NodeUp,
    PolicyLoaded,
    SafetyReset,
    SafetyState,
    SafetyStop,
    Tick,
)
from common.metrics import Sample
from common.service import AnyMessage, Reactor
from services.control.attempt import Attempt
from services.control.events import (
    AttemptEnded,
    AttemptStarted,
    CancelEvaluation,
    CellsChanged,
    EvaluationEnded,
    LoadPolicy,
    NodesChanged,
    PictureArrived,
    ResetCells,
    StopCells,
    SubmitEvaluation,
    TrialEnded,
    TrialSpec,
    WaitingChanged,
)
from services.control.lane import EvaluationRun
from services.control.loading import PolicyLoading
from services.control.losses import LossWindow
from services.control.measured import Measured
from services.control.nodes import Need, NodeRegistry
from services.control.safety_board import SafetyBoard

MAX_ATTEMPTS = 2
READY_TIMEOUT_S = 20.0
REJOIN_S = 60.0
SILENCE_S = 30.0
"""A cell's owner beats once a second; after this much silence it is taken to hang."""


def growing_epochs() -> Callable[[], int]:
    """Epochs that grow over restarts too: milliseconds since 1970, or one more than the last."""
    last = 0

    def next_epoch() -> int:
        nonlocal last
        last = max(last + 1, time.time_ns() // 1_000_000)
        return last

    return next_epoch


class Scheduler(Reactor):
    """Runs evaluations: one trial at a time per cell, all idle cells at once.

    Args:
        new_epoch: Gives a larger number at each call, also after a restart.
        ready_timeout_s: How long the nodes of an episode may take to prepare it.
        rejoin_s: How long a trial waits for a node that is missing.
        lease_s: How long a node that hangs is believed to be alive: a tick waits for an answer
            somewhat longer, and an attempt in real time is not repeated before that.
    """

    kind = "control"
    inputs = (
        SafetyState,
        EpisodeReady,
        EpisodeResult,
        EpisodePicture,
        PolicyLoaded,
        NodeDescription,
        NodeMetrics,
    )
    watches_nodes = True

    def __init__(
        self,
        *,
        new_epoch: Callable[[], int] | None = None,
        ready_timeout_s: float = READY_TIMEOUT_S,
        rejoin_s: float = REJOIN_S,
        lease_s: float = LOCAL_LEASE_S,
    ) -> None:
        self._new_epoch = new_epoch or growing_epochs()
        self._ready_timeout_s = ready_timeout_s
        self._rejoin_s = rejoin_s
        self._lease_s = lease_s
        self._registry = NodeRegistry()
        self._loading = PolicyLoading(self._registry)
        self._losses = LossWindow()
        self._measured = Measured()
        self._safety = SafetyBoard()
        self._runs: dict[str, EvaluationRun] = {}
        self._attempts: dict[str, Attempt] = {}
        self._now_ns: int | None = None
        self._nodes_changed = False
        self._to_bus: list[Message | AskDescription] = []
        self._to_edge: list[LocalMessage] = []

    @property
    def tick_period_s(self) -> float:
        """Often enough to name a loss within 0.25 s."""
        return 0.05

    def handle(self, messages: Sequence[AnyMessage]) -> Iterable[AnyMessage]:
        """Take what is waiting; the bus comes first in what is returned.

        So the next episode is being prepared while the edge writes down the last one.
        """
        for message in messages:
            self._take(message)
        if self._now_ns is not None:
            self._hand_out(self._now_ns)
        if self._nodes_changed:
            self._nodes_changed = False
            self._tell_cells()
            self._to_edge.append(NodesChanged(self._registry.infos()))
        self._to_bus[:0] = self._safety.take_due(self._now_ns or 0)
        outputs = [*self._to_bus, *self._to_edge]
        self._to_bus.clear()
        self._to_edge.clear()
        return outputs

    def measure(
        self, given: Sequence[AnyMessage], returned: Sequence[AnyMessage], began_ns: int
    ) -> Iterable[Sample]:
        """Count the trials that have ended."""
        self._measured.add(returned)
        return super().measure(given, returned, began_ns)

    def levels(self) -> Iterable[Sample]:
        """Nodes, evaluations and trials."""
        return self._measured.levels(
            self._registry.infos(), self._runs.values(), len(self._attempts)
        )

    def _send(self, messages: Iterable[AnyMessage]) -> None:
        for message in messages:
            if isinstance(message, Message | AskDescription):
                self._to_bus.append(message)
            else:
                self._to_edge.append(message)

    def _take(self, message: AnyMessage) -> None:
        match message:
            case Tick():
                self._advance(message.t_mono_ns)
            case EpisodeReady():
                self._take_ready(message)
            case EpisodeResult():
                self._take_result(message)
            case EpisodePicture():
                self._take_picture(message)
            case SubmitEvaluation():
                run = self._runs[message.evaluation] = EvaluationRun(message)
                self._finish_if_empty(run)
            case CancelEvaluation():
                self._cancel(message.evaluation)
            case SafetyState():
                self._take_safety(message)
            case StopCells():
                self._stop_cells(message)
            case ResetCells():
                for cell in message.cells:
                    self._safety.order(SafetyReset(header=Header(cell=cell), by=message.by))
            case LoadPolicy():
                self._send(self._loading.order(message))
            case PolicyLoaded():
                self._send(self._loading.take_answer(message))
            case _:
                self._take_node_news(message)

    def _take_node_news(self, message: AnyMessage) -> None:
        match message:
            case NodeUp():
                self._registry.add(message.kind, message.node)
                self._loading.restart(message.node)
                self._ask_undescribed()
            case NodeDown():
                unanswered = self._registry.lose(message.kind, message.node)
                self._send(self._loading.lose(unanswered, message.node))
                self._lose(message.kind, message.node)
                if message.kind == "sim":
                    self._safety.lose(message.node)
            case NodeDescription():
                self._registry.describe(message)
                self._send(self._loading.load_again(message.node))
            case NodeMetrics():
                self._notice_restart(message)
                self._registry.measure(message)
                owned = self._attempts.get(message.node)
                if owned is not None and self._now_ns is not None:
                    owned.heard(self._now_ns)
            case _:
                return
        self._nodes_changed = True

    def _notice_restart(self, metrics: NodeMetrics) -> None:
        restarted = self._registry.find_restarted(metrics)
        if restarted is not None:
            self._take_node_news(NodeDown(*restarted))
            self._take_node_news(NodeUp(*restarted))

    def _advance(self, now_ns: int) -> None:
        """Time has passed: what is due now?"""
        self._now_ns = now_ns
        self._ask_undescribed()
        if self._losses.is_due(now_ns):
            for attempt in [a for a in self._attempts.values() if a.lost]:
                self._abort(attempt, self._losses.name_cause(attempt.lost))
            self._losses.close()
        for attempt in list(self._attempts.values()):
            self._check_silence(attempt, now_ns)
        for run in list(self._runs.values()):
            self._check_missing(run, now_ns)

    def _ask_undescribed(self) -> None:
        nodes = self._registry.undescribed(self._now_ns or 0)
        self._to_bus.extend(AskDescription(node) for node in nodes)

    def _lose(self, kind: str, node: str) -> None:
        self._losses.note(kind, node, self._now_ns or 0)
        for attempt in self._attempts.values():
            if attempt.nodes.get(kind) == node:
                attempt.lost.append((kind, node))

    def _check_silence(self, attempt: Attempt, now_ns: int) -> None:
        if attempt.lost:
            return
        silent_s = (now_ns - attempt.since_ns) * 1e-9
        if attempt.running and silent_s >= SILENCE_S:
            text = f"sim {attempt.cell} gave no sign of life for {SILENCE_S:.0f} s"
            self._abort(attempt, write_reason(Cause.NODE_TIMEOUT, text))
        elif not attempt.running and silent_s >= self._ready_timeout_s:
            silent = ", ".join(f"{kind} {attempt.nodes[kind]}" for kind in sorted(attempt.unready))
            text = f"{silent} did not get ready within {self._ready_timeout_s:.0f} s"
            self._abort(attempt, write_reason(Cause.NODE_TIMEOUT, text))

    def _check_missing(self, run: EvaluationRun, now_ns: int) -> None:
        if run.look(self._registry, now_ns, unreset=self._list_unreset()):
            self._to_edge.append(WaitingChanged(run.id, run.waiting))
        for trial, missing in run.take_overdue(self._rejoin_s, now_ns):
            text = f"{', '.join(missing)} missing for {self._rejoin_s:.0f} s"
            self._end(run, trial, write_reason(Cause.NODE_MISSING, text))
        self._finish_if_empty(run)

    def _hand_out(self, now_ns: int) -> None:
        """Give every idle cell the first trial that can run now."""
        load = Counter(node for a in self._attempts.values() for node in a.nodes.values())
        for sim in self._registry.ready(Need("sim")):
            if sim.node in self._attempts or self._safety.is_stopped(sim.node):
                continue
            for run in self._runs.values():
                taken = run.take_next(self._registry, load, now_ns, cell=sim.node)
                if taken is not None:
                    trial, nodes = taken
                    self._begin(run, trial, {"sim": sim.node, **nodes}, now_ns)
                    load.update(nodes.values())
                    break

    def _begin(
        self, run: EvaluationRun, trial: TrialSpec, nodes: dict[str, str], now_ns: int
    ) -> None:
        attempt = Attempt(trial, nodes, self._new_epoch(), now_ns)
        self._attempts[attempt.cell] = attempt
        self._to_bus.append(attempt.configure(run.request, lease_s=self._lease_s))
        versions = self._registry.versions(nodes, policy=trial.policy)
        self._to_edge.append(
            AttemptStarted(trial, attempt.number, attempt.epoch, attempt.cell, versions)
        )

    def _current(self, message: Message) -> Attempt | None:
        """The attempt a message speaks of; one of another epoch speaks of none."""
        attempt = self._attempts.get(message.header.cell)
        if attempt is None or attempt.epoch != message.header.epoch:
            return None
        return attempt

    def _take_ready(self, message: EpisodeReady) -> None:
        attempt = self._current(message)
        if attempt is None or attempt.nodes.get(message.kind) != message.node:
            return
        problem = message.problem
        if problem is not None:
            text = f"{problem.happened}; {problem.expected}; {problem.action}"
            who = f"{message.kind} {message.node}"
            self._abort(attempt, write_reason(Cause.NODE_PROBLEM, f"{who}: {text}"))
            return
        attempt.unready.discard(message.kind)
        if not attempt.unready and not attempt.running:
            self._to_bus.append(attempt.start(self._now_ns or 0))

    def _take_result(self, message: EpisodeResult) -> None:
        attempt = self._current(message)
        if attempt is None:
            return
        result = message.result
        if result.outcome == "aborted":
            # With a participant lost, the loss is the cause and will be named in a moment.
            if not attempt.lost:
                self._abort(attempt, result.reason, tell_cell=False)
        elif attempt.running:
            del self._attempts[attempt.cell]
            run = self._runs[attempt.trial.evaluation]
            self._to_edge.append(TrialEnded(attempt.trial, result.outcome, result.reason, result))
            self._finish_if_empty(run)

    def _stop_cells(self, order: StopCells) -> None:
        for cell in order.cells:
            header = Header(cell=cell)
            self._safety.order(SafetyStop(header=header, by=order.by, reason=order.reason))
            self._end_stopped(cell, EmergencyStopped(cell, order.by, order.reason).describe())

    def _take_safety(self, state: SafetyState) -> None:
        """A guard speaks; whoever else pressed the button, the trial there is over."""
        cell = state.header.cell
        self._safety.hear(state)
        if state.emergency_stop and state.fault is not None:
            self._end_stopped(cell, state.fault.model_dump())
        self._tell_cells()

    def _end_stopped(self, cell: str, fault: Mapping[str, str]) -> None:
        """End the trial of a cell for good: who stopped it does not want to see it again."""
        attempt = self._attempts.pop(cell, None)
        if attempt is not None:
            text = f"{fault['happened']} ({fault['code']})"
            reason = write_reason(Cause.EMERGENCY_STOP, text)
            self._to_bus.append(attempt.abort(reason))
            self._end(self._runs[attempt.trial.evaluation], attempt.trial, reason)

    def _list_unreset(self) -> tuple[str, ...]:
        """What trials wait for when every cell that could take them is stopped."""
        cells = [node.node for node in self._registry.ready(Need("sim"))]
        stopped = [cell for cell in cells if self._safety.is_stopped(cell)]
        return tuple(f"reset of {cell}" for cell in stopped) if stopped == cells else ()

    def _tell_cells(self) -> None:
        self._to_edge.append(CellsChanged(self._safety.infos(self._registry)))

    def _take_picture(self, message: EpisodePicture) -> None:
        """Pictures come before the result: with it the cell goes on to its next epoch."""
        attempt = self._current(message)
        if attempt is not None:
            self._to_edge.append(PictureArrived(attempt.trial, message))

    def _abort(self, attempt: Attempt, reason: str, *, tell_cell: bool = True) -> None:
        """End an attempt without a result; the trial gets one more, or ends."""
        del self._attempts[attempt.cell]
        if tell_cell:
            self._to_bus.append(attempt.abort(reason))
        run = self._runs[attempt.trial.evaluation]
        if attempt.number >= MAX_ATTEMPTS:
            self._end(run, attempt.trial, reason)
            return
        self._to_edge.append(AttemptEnded(attempt.trial, attempt.number, reason))
        again = replace(attempt.trial, spent=attempt.number)
        # In lockstep a tick has waited longer than a lease for a node that hangs; in real time one
        # may hang that is still believed to be alive.
        unseen = run.request.mode == "realtime"
        wait_s = self._lease_s if unseen else min(self._lease_s, LOCAL_LEASE_S)
        run.put_back(again, not_before_ns=(self._now_ns or 0) + int(wait_s * 1e9))

    def _end(self, run: EvaluationRun, trial: TrialSpec, reason: str) -> None:
        self._to_edge.append(TrialEnded(trial, "aborted", reason))
        self._finish_if_empty(run)

    def _finish_if_empty(self, run: EvaluationRun) -> None:
        busy = any(a.trial.evaluation == run.id for a in self._attempts.values())
        if not busy and not run.has_pending and self._runs.pop(run.id, None) is not None:
            self._to_edge.append(EvaluationEnded(run.id, "done"))

    def _cancel(self, evaluation: str) -> None:
        if self._runs.pop(evaluation, None) is None:
            return
        for attempt in list(self._attempts.values()):
            if attempt.trial.evaluation == evaluation:
                del self._attempts[attempt.cell]
                self._to_bus.append(attempt.abort("cancelled"))
        self._to_edge.append(EvaluationEnded(evaluation, "cancelled"))
