"""One episode of one cell: which tick may be answered, and with what."""

from __future__ import annotations

import logging
import time
from collections import deque

from common.clock import TICK_S
from common.errors import InvalidValue, LegatoError, WrongShape
from common.log import about
from common.messages import (
    EpisodeConfigure,
    Message,
    PolicyAction,
    RobotCommand,
    RobotState,
)
from common.messages.base import has_unit_quaternion
from common.robots import RobotSpec
from common.safety import SingleWriter
from common.se3 import Array
from services.retarget.lag import TrackingLag
from services.retarget.reference import GripperReference, Lead
from services.retarget.report import FrameReport, TickRecord
from services.retarget.retargeter import Retargeter

log = logging.getLogger(__name__)

POLICY_SILENCE_TICKS = 13
"""Real time: so long after an action was taken the next is overdue, and the robot is braked until
it comes. An action lasts ten ticks; three more are for its successor's delay."""


class RetargetEpisode:
    """Answers each tick once, in order, and repeats its last answer when asked again.

    In lockstep a tick that names a due frame waits for that frame's action. In real time an action
    takes effect at the next state.

    Args:
        configure: The episode.
        spec: Its robot.
        retargeter: A retargeter of that robot that no other episode uses.
        writer: Whose states and actions count.
    """

    def __init__(
        self,
        configure: EpisodeConfigure,
        spec: RobotSpec,
        retargeter: Retargeter,
        writer: SingleWriter,
    ) -> None:
        self.configure = configure
        self.writer = writer
        self._spec = spec
        self._retargeter = retargeter
        self._reference: GripperReference | None = None
        self._lag: TrackingLag | None = None
        self._actions: dict[int, PolicyAction] = {}
        self._newest_taken = -1
        self._acted_step: int | None = None
        self._waiting: RobotState | None = None
        self._answered = -1
        self._answer: list[Message] = []
        self._report = FrameReport()
        # References as the robot has got to know them: it is told of one a latency ago.
        self._expected = deque[Array](maxlen=round(spec.command_latency_s / TICK_S) + 1)
        self._complained = False

    @property
    def epoch(self) -> int:
        """Which run of the cell this is."""
        return self.configure.header.epoch

    def take_action(self, action: PolicyAction) -> list[Message]:
        """Keep an action until it is due; answer the tick that waited for it, if any."""
        if action.for_step > self._newest_taken:
            self._actions[action.for_step] = action
        return self._answer_waiting()

    def take_state(self, state: RobotState) -> list[Message]:
        """Answer a tick, now or when its action is there."""
        step = state.header.step
        if step == self._answered:
            return self._answer
        if step < self._answered or not self._is_usable(state):
            return []
        self._waiting = state
        return self._answer_waiting()

    def _answer_waiting(self) -> list[Message]:
        state = self._waiting
        if state is None:
            return []
        due = self._list_due(state)
        if due is None:
            return []
        self._waiting = None
        missed = state.header.step - self._answered - 1
        self._answered = state.header.step
        self._answer = self._answer_state(state, due, missed)
        return self._answer

    def _list_due(self, state: RobotState) -> list[PolicyAction] | None:
        """Actions that take effect at this state, oldest first; None if one is still missing."""
        if self.configure.mode == "realtime":
            due = sorted(self._actions)
        elif state.due_frame_step < 0:
            return []
        elif state.due_frame_step not in self._actions:
            return None
        else:
            due = [state.due_frame_step]
        actions = [self._actions[step] for step in due]
        if due:
            self._newest_taken = due[-1]
            self._actions = {
                step: action for step, action in self._actions.items() if step > due[-1]
            }
        return actions

    def _answer_state(
        self, state: RobotState, due: list[PolicyAction], missed: int
    ) -> list[Message]:
        retargeter = self._retargeter
        T_world_tool = retargeter.compute_tool_pose(state.positions)
        if self._reference is None or self._lag is None:
            gains = self._spec.retarget
            lead = Lead(
                gains.setpoint_lead_m, gains.setpoint_lead_rad, lambda: retargeter.T_world_hand
            )
            self._reference = GripperReference(T_world_tool, lead=lead)
            self._lag = TrackingLag(T_world_tool, lag_s=self.configure.tracking_lag_s)
            retargeter.start(state.positions)
        for action in due:
            self._reference.take(action.steps)
            self._acted_step = state.header.step
        started = time.perf_counter()
        if self._policy_is_silent(state):
            T_world_wanted = retargeter.T_world_hand
            motion = retargeter.brake(missed + 1)
            self._reference.rest_at(retargeter.T_world_hand)
            self._lag.rest_at(retargeter.T_world_hand)
        else:
            wanted = self._reference.advance()
            T_world_wanted = wanted.T_world_start
            motion = retargeter.follow(self._lag.follow(wanted), state.positions)
        solve_time_s = time.perf_counter() - started
        # The runner stamps source, sequence number and time.
        command = RobotCommand(
            header=state.header,
            for_step=state.header.step,
            request_t_mono_ns=state.header.t_mono_ns,
            positions=motion.positions,
            velocities=motion.velocities,
        )
        self._expected.append(T_world_wanted)
        tick = TickRecord(self._expected[0], T_world_tool, motion, solve_time_s)
        status = self._report.add(tick, state.header)
        return [command] if status is None else [status, command]

    def _policy_is_silent(self, state: RobotState) -> bool:
        """Real time: whether the next action is overdue; before the first none is.

        What is left of a chunk does not count: it was planned from what was seen long ago.
        """
        if self.configure.mode != "realtime" or self._acted_step is None:
            return False
        return state.header.step - self._acted_step > POLICY_SILENCE_TICKS

    def _is_usable(self, state: RobotState) -> bool:
        """Whether a state is one of this robot; the first that is not is told of."""
        fault = self._find_fault(state)
        if fault is not None and not self._complained:
            self._complained = True
            log.error("state ignored", extra={**about(state.header), **fault.describe()})
        return fault is None

    def _find_fault(self, state: RobotState) -> LegatoError | None:
        spec, positions, velocities = self._spec, state.positions, state.velocities
        if len(positions) != spec.nq:
            return WrongShape("RobotState.positions", spec.nq, len(positions))
        if len(velocities) != spec.nv:
            return WrongShape("RobotState.velocities", spec.nv, len(velocities))
        if spec.kind == "free_hand" and not has_unit_quaternion(positions):
            return InvalidValue("RobotState quaternion", positions[3:], "length 1")
        return None
