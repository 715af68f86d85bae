"""One episode in one world: ticks out, answers in, until success, failure or abort."""

from __future__ import annotations

import math
import time
from typing import Final

from common.aborts import Cause, write_reason
from common.calibration import StereoCalibration
from common.clock import FRAME_TICKS, TICK_S, LockstepBarrier, RealtimePacer, closes_frame
from common.errors import LegatoError, ModelError
from common.messages import (
    EpisodeConfigure,
    EpisodeEvent,
    EpisodeResult,
    GroundTruth,
    Header,
    Message,
    MotorCommand,
    MotorState,
    Outcome,
    PolicyAction,
    RetargetStatus,
    RobotCommand,
    RobotState,
    StereoFrame,
    TrialResult,
)
from common.safety import Setpoint, SingleWriter
from common.se3 import pose_to_wire
from common.tasks.task import Judgement, SuccessMonitor
from services.sim.album import Album
from services.sim.body import GuardedBody
from services.sim.camera import Sensor, Skin, StereoCamera
from services.sim.counts import LiveCounts
from services.sim.measurements import Ending, Measurements
from services.sim.stages import StageMonitor
from services.sim.trace import Trace

RESEND_S: Final = 0.4
_MOMENT_DELAY_TICKS: Final = {"grasp": 80, "release": 30}
"""Fingers take time: a picture at the command itself would show nothing."""

_COMMAND, _STATUS, _MOTOR, _ACTION = "robot/command", "retarget/status", "motor_command", "action"
_NODE_OF = {_COMMAND: "retarget", _STATUS: "retarget", _MOTOR: "gripper", _ACTION: "policy"}


class Episode:
    """State of a running episode. Given answers, it returns what to publish.

    In lockstep a tick is taken when the joint command, the motor command and, where one is due,
    the policy action have arrived. In real time a tick is taken when its time has come, with the
    newest commands there are.

    Args:
        configure: What was asked for.
        writer: Whose answers count.
        body: The robot in a world built for this episode.
        camera: The gripper's stereo camera in that world.
        calibration: What the camera was built from.
        sensor: Changes the pictures as a real one does; without it they stay clean.
        skin: Meshes of the robot, for the pictures of its key moments.
    """

    def __init__(
        self,
        configure: EpisodeConfigure,
        writer: SingleWriter,
        body: GuardedBody,
        camera: StereoCamera,
        calibration: StereoCalibration,
        sensor: Sensor | None = None,
        skin: Skin | None = None,
    ) -> None:
        self.configure = configure
        self.writer = writer
        self.body = body
        self.pacer = RealtimePacer(period_s=TICK_S)
        world = self._world = body.world
        self._album = Album(world, skin)
        self._camera = camera
        self._calibration = calibration
        self._sensor = sensor
        self._latency_ticks = math.ceil(configure.action_latency_s / TICK_S - 1e-9)
        self._barrier = LockstepBarrier(resend_s=RESEND_S, deadline_s=configure.node_deadline_s)
        self._monitor = SuccessMonitor()
        self._stages = StageMonitor(world.task.moved_object)
        self._measured = Measurements()
        self._trace = Trace()
        self._step = 0
        self._grasp = False
        self._motor: MotorCommand | None = None
        self._actions: dict[int, PolicyAction] = {}
        self._frame: StereoFrame | None = None
        self._sent: list[Message] = []
        self._moment: tuple[int, str] | None = None
        self._started_s = 0.0
        self._result: TrialResult | None = None

    @property
    def over(self) -> bool:
        """Whether there is a result."""
        return self._result is not None

    @property
    def realtime(self) -> bool:
        """Whether wall time paces the episode."""
        return self.configure.mode == "realtime"

    @property
    def counts(self) -> LiveCounts:
        """Where it counts, for metrics."""
        return LiveCounts(self._measured, self._barrier, self.pacer, self.body.guard.counts)

    def start(self) -> list[Message]:
        """Start the clock: the messages of tick 0.

        Raises:
            LegatoError: The robot may not move.
        """
        self.body.guard.start()
        self._started_s = time.perf_counter()
        messages = [self._event("started"), *self._open_tick()]
        self._album.remember("start", self._frame)
        return messages

    def take(self, answer: Message) -> list[Message]:
        """Take one answer and go on as far as it allows."""
        if self.over or not self.writer.accepts(answer):
            return []
        if isinstance(answer, RobotCommand):
            if answer.for_step == self._step or (self.realtime and answer.for_step < self._step):
                command = Setpoint(answer.positions, answer.velocities)
                self.body.guard.offer(command, made_s=answer.for_step * TICK_S)
                self._barrier.arrive(_COMMAND)
        elif isinstance(answer, MotorCommand):
            if answer.for_step == self._step or self.realtime:
                self._motor = answer
                self._barrier.arrive(_MOTOR)
        elif isinstance(answer, PolicyAction):
            self._take_action(answer)
        elif isinstance(answer, RetargetStatus) and (
            answer.for_step == self._step or self.realtime
        ):
            self._measured.add_status(answer)
            self._barrier.arrive(_STATUS)
        if not self.realtime and self._barrier.complete:
            return self._close_tick()
        return []

    def stop(self, fault: LegatoError) -> list[Message]:
        """Brake, latch a fault and end the episode with it."""
        self.body.guard.stop(fault)
        return self._end("aborted", write_reason(Cause.EMERGENCY_STOP, f"{fault} ({fault.code})"))

    def pass_time(self, now_ns: int) -> list[Message]:
        """Let wall time pass: pace in real time, watch for silence in lockstep.

        Args:
            now_ns: This process's monotonic clock.
        """
        if self.over:
            return []
        if self.realtime:
            # One at a time: after a late one, the next gets the command for it.
            return self._close_realtime_tick() if self.pacer.due(now_ns) else []
        verdict = self._barrier.check(now_ns)
        if verdict.overdue:
            nodes = sorted({self.configure.nodes[_NODE_OF[kind]] for kind in verdict.overdue})
            silent = ", ".join(nodes)
            text = f"{silent} did not answer tick {self._step}"
            return self._end("aborted", write_reason(Cause.NODE_TIMEOUT, text))
        return list(self._sent) if verdict.resend else []

    def _take_action(self, action: PolicyAction) -> None:
        if self.realtime:
            if self._frame is not None and action.for_step == self._frame.header.step:
                self._actions = {action.for_step: action}
            self._measured.add_action(action)
            self._set_grasp(action)
            return
        if action.for_step >= self._step - self._latency_ticks:
            self._actions[action.for_step] = action
        if action.for_step == self._due_frame():
            self._barrier.arrive(_ACTION)

    def _due_frame(self) -> int:
        """The frame whose action takes effect at this tick, or -1."""
        frame = self._step - self._latency_ticks
        return frame if frame >= 0 and frame % FRAME_TICKS == 0 else -1

    def _open_tick(self) -> list[Message]:
        """What is published at the start of a tick."""
        header = self._header()
        due = -1 if self.realtime else self._due_frame()
        positions = self._world.servos.positions(self._world.data)
        velocities = self._world.servos.velocities(self._world.data)
        fingers, data = self._world.fingers, self._world.data
        self._trace.add_bytes(b"state", data.qpos.data, data.qvel.data)
        messages: list[Message] = []
        if self._step % FRAME_TICKS == 0:
            messages += self._look(header)
        messages += [
            RobotState(
                header=header, positions=positions, velocities=velocities, due_frame_step=due
            ),
            MotorState(
                header=header,
                positions_rad=fingers.positions_rad(data),
                velocities_rad_s=fingers.velocities_rad_s(data),
                currents_a=fingers.currents_a(data),
                due_frame_step=due,
            ),
        ]
        expected = {_COMMAND, _MOTOR}
        if closes_frame(self._step):
            expected.add(_STATUS)
        if due >= 0 and due not in self._actions:
            expected.add(_ACTION)
        self._barrier.open(expected)
        self._sent = messages
        return messages

    def _look(self, header: Header) -> list[Message]:
        if self.realtime and self._step > 0 and not self._actions:
            self._measured.missed_frames += 1
        began_s = time.perf_counter()
        left, right = self._camera.render(self._world.data)
        if self._sensor is not None:
            left, right = self._sensor.expose(left, right, step=self._step)
        self._measured.camera_s += time.perf_counter() - began_s
        self._trace.add_bytes(b"left", left)
        self._trace.add_bytes(b"right", right)
        self._frame = StereoFrame(
            header=header,
            camera=self.configure.camera,
            width=self._calibration.width,
            height=self._calibration.height,
            left=left,
            right=right,
            due_step=-1 if self.realtime else self._step + self._latency_ticks,
        )
        if self.realtime:
            self._actions = {}
        truth = GroundTruth(
            header=header,
            T_world_tool=pose_to_wire(self._world.T_world_tool),
            objects=self._world.object_poses(),
            opening_m=self._world.fingers.opening_m(self._world.data),
        )
        return [self._frame, truth]

    def _close_tick(self) -> list[Message]:
        """Lockstep: all answers are there. Act, step physics, judge, open the next tick."""
        due = self._due_frame()
        if due >= 0:
            action = self._actions.pop(due)
            self._measured.add_action(action)
            self._set_grasp(action)
            step = action.steps[0]
            self._trace.add_numbers(
                b"action", [*step.translation_m, *step.rotation_rad, float(step.grasp)]
            )
        if self._motor is None:
            raise AssertionError("the barrier is complete without its commands")
        return self._close()

    def _close_realtime_tick(self) -> list[Message]:
        if not self.body.guard.following:
            self._measured.held_ticks += 1
        return self._close()

    def _close(self) -> list[Message]:
        """Move as the guard says, and end the episode if it found a fault."""
        setpoint = self.body.command()
        self._trace.add_numbers(b"command", [*setpoint.positions, *setpoint.velocities])
        if self._motor is not None:
            self._move_fingers(self._motor)
        problem = self._step_physics()
        if problem is not None:
            # The owner of a cell has its name.
            return self._abort(self.configure.header.cell, problem)
        fault = self.body.fault
        if fault is not None:
            node = self.configure.nodes["retarget"]
            return self._abort(node, fault, Cause.ROBOT_FAULT)
        return self._judge()

    def _move_fingers(self, motor: MotorCommand) -> None:
        fingers = self._world.fingers
        fingers.command(motor.positions_rad, current_limit_a=motor.current_limit_a)
        self._trace.add_numbers(b"motor", [*motor.positions_rad, motor.current_limit_a])

    def _step_physics(self) -> ModelError | None:
        began_s = time.perf_counter()
        try:
            self.body.advance()
        except ModelError as error:
            return error
        self._measured.physics_s += time.perf_counter() - began_s
        return None

    def _judge(self) -> list[Message]:
        """Look at the state just reached, and open the next tick unless it ends the episode."""
        self._step += 1
        if self._moment is not None and self._step >= self._moment[0]:
            self._album.remember(self._moment[1], self._frame)
            self._moment = None
        if not self._world.is_bounded():
            return self._end("failure", "the simulation diverged")
        # No task can be done while the gripper is closed: then look at frames only.
        if self._grasp and self._step % FRAME_TICKS:
            return self._open_tick()
        state = self._world.task_state(grasp=self._grasp)
        judgement = self._world.task.judge(state)
        self._stages.update(state, judgement, step=self._step)
        if self._monitor.update(judgement):
            return self._end("success", "all conditions held for 0.5 s")
        if judgement.lost is not None:
            return self._end("failure", judgement.lost, judgement)
        if self._step * TICK_S >= self._world.task.time_limit_s:
            limit = f"time limit of {self._world.task.time_limit_s:g} s"
            return self._end("failure", limit, judgement)
        return self._open_tick()

    def _set_grasp(self, action: PolicyAction) -> None:
        grasp = action.steps[0].grasp
        if grasp != self._grasp:
            self._grasp = grasp
            moment = "grasp" if grasp else "release"
            self._moment = (self._step + _MOMENT_DELAY_TICKS[moment], moment)

    def _abort(
        self, node: str, error: LegatoError, cause: Cause = Cause.NODE_PROBLEM
    ) -> list[Message]:
        """End the episode because of what a node has made, and name it."""
        text = f"{node}: {error} ({error.code})"
        return self._end("aborted", write_reason(cause, text))

    def _end(
        self, outcome: Outcome, reason: str, judgement: Judgement | None = None
    ) -> list[Message]:
        self._album.remember("end", self._frame, last=True)
        distance = self._monitor.smallest_distance_m
        self._result = self._measured.result(
            Ending(outcome, reason, judgement.failed if judgement is not None else ()),
            ticks=self._step,
            wall_time_s=time.perf_counter() - self._started_s,
            stages=self._stages.reached,
            goal_distance_m=distance if math.isfinite(distance) else 0.0,
            resends=self._barrier.resends,
            trace_sha256=self._trace.hexdigest(),
        )
        event = {"success": "succeeded", "failure": "failed", "aborted": "aborted"}[outcome]
        draw = self.configure.pictures and outcome != "aborted"
        # The result is last: with it the cell is free for its next epoch.
        return [
            self._event(event, reason),
            *(self._album.draw(self._header()) if draw else ()),
            EpisodeResult(header=self._header(), result=self._result),
        ]

    def _event(self, event: str, detail: str = "") -> EpisodeEvent:
        return EpisodeEvent.model_validate(
            {"header": self._header(), "event": event, "detail": detail}
        )

    def _header(self) -> Header:
        return self.configure.header.at(self._step, self._step * TICK_S)
