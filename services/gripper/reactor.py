"""The gripper driver as a reactor: one driver per cell."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from common.clock import FRAME_TICKS
from common.errors import LegatoError
from common.messages import (
    EpisodeAbort,
    EpisodeConfigure,
    EpisodeReady,
    GripperState,
    Message,
    MotorCommand,
    MotorState,
    PolicyAction,
    Problem,
)
from common.metrics import Sample
from common.safety import ForeignCounts, SingleWriter
from common.service import AnyMessage, Reactor
from services.gripper.driver import Driver, DriverConfig
from services.gripper.motors import MotorReading, SimulatedMotors


@dataclass
class _Cell:
    """State of one cell's gripper in one episode."""

    configure: EpisodeConfigure
    writer: SingleWriter
    motors: SimulatedMotors
    driver: Driver
    actions: dict[int, PolicyAction] = field(default_factory=dict[int, PolicyAction])
    """By frame: with a latency above the period the next one comes before this one is due."""
    waiting: MotorState | None = None
    last_step: int = -1
    last_reply: list[Message] = field(default_factory=list[Message])


class GripperReactor(Reactor):
    """Drives the grippers of any number of cells.

    Args:
        node: Its name.
        config: Speeds and limits of the fingers.
    """

    kind = "gripper"
    inputs = (EpisodeConfigure, EpisodeAbort, MotorState, PolicyAction)

    def __init__(self, *, node: str, config: DriverConfig | None = None) -> None:
        self.node = node
        self._config = config or DriverConfig()
        self._cells: dict[str, _Cell] = {}
        self._foreign = ForeignCounts(MotorState, PolicyAction)

    def serves(self, cell: str) -> bool:
        """Only cells whose episode uses this driver."""
        return cell in self._cells

    def handle(self, messages: Sequence[AnyMessage]) -> Iterable[AnyMessage]:
        """Take readings and actions, return motor commands and gripper states."""
        outputs: list[AnyMessage] = []
        for message in messages:
            if isinstance(message, MotorState | PolicyAction):
                outputs += self._pass_on(message)
            elif isinstance(message, EpisodeConfigure):
                outputs += self._prepare(message)
            elif isinstance(message, EpisodeAbort):
                self._cells.pop(message.header.cell, None)
        return outputs

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
            motors = SimulatedMotors()
            driver = Driver(motors, self._config)
            self._cells[configure.header.cell] = _Cell(configure, writer, motors, driver)
        except LegatoError as error:
            problem = Problem(**error.describe())
        return [
            EpisodeReady(header=configure.header, node=self.node, kind=self.kind, problem=problem)
        ]

    def _pass_on(self, message: MotorState | PolicyAction) -> list[Message]:
        cell = self._cells.get(message.header.cell)
        if cell is None or not cell.writer.accepts(message):
            return []
        if isinstance(message, MotorState):
            return self._take_state(cell, message)
        return self._take_action(cell, message)

    def _take_action(self, cell: _Cell, action: PolicyAction) -> list[Message]:
        if cell.configure.mode == "realtime":
            cell.driver.grasp = action.steps[0].grasp
            return []
        cell.actions[action.for_step] = action
        if cell.waiting is not None:
            return self._take_state(cell, cell.waiting)
        return []

    def _take_state(self, cell: _Cell, state: MotorState) -> list[Message]:
        if state.header.step < cell.last_step:
            return []
        if state.header.step == cell.last_step:
            return cell.last_reply
        cell.waiting = None
        if state.due_frame_step >= 0:
            action = cell.actions.get(state.due_frame_step)
            if action is None:
                cell.waiting = state
                return []
            cell.driver.grasp = action.steps[0].grasp
            cell.actions = {
                step: each for step, each in cell.actions.items() if step > state.due_frame_step
            }
        cell.last_step = state.header.step
        cell.last_reply = self._drive(cell, state)
        return cell.last_reply

    def _drive(self, cell: _Cell, state: MotorState) -> list[Message]:
        cell.motors.receive(
            MotorReading(
                _pair(state.positions_rad), _pair(state.velocities_rad_s), _pair(state.currents_a)
            )
        )
        report = cell.driver.step()
        goal = cell.motors.goal
        if goal is None:
            raise RuntimeError("the driver wrote no goal")
        # The runner stamps source, sequence number and time.
        header = state.header
        step, asked_ns = header.step, header.t_mono_ns
        replies: list[Message] = [
            MotorCommand(
                header=header,
                for_step=step,
                request_t_mono_ns=asked_ns,
                positions_rad=list(goal.positions_rad),
                current_limit_a=goal.current_limit_a,
            )
        ]
        # The state as a tool changes slowly: 10 Hz is what its readers need.
        if step % FRAME_TICKS == 0:
            replies.append(
                GripperState(
                    header=header,
                    for_step=step,
                    request_t_mono_ns=asked_ns,
                    opening_m=report.opening_m,
                    grasp=cell.driver.grasp,
                    moving=report.moving,
                    gripped=report.gripped,
                )
            )
        return replies


def _pair(values: list[float]) -> tuple[float, float]:
    left, right = values
    return left, right
