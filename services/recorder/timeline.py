"""The messages of one running episode, by the frame they belong to."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from common.clock import FRAME_TICKS
from common.datasets import EpisodeRows, Rows
from common.messages import (
    ActionStep,
    EpisodeConfigure,
    GripperState,
    GroundTruth,
    Message,
    PolicyAction,
    RetargetStatus,
    RobotState,
    StereoFrame,
)
from services.recorder.columns import object_column


@dataclass
class Moment:
    """What belongs to one frame."""

    frame: StereoFrame | None = None
    action: PolicyAction | None = None
    truth: GroundTruth | None = None
    state: RobotState | None = None
    gripper: GripperState | None = None
    reference: list[float] | None = None

    def missing(self) -> list[str]:
        """What has not come."""
        parts = (
            ("camera/stereo", self.frame),
            ("policy/action", self.action),
            ("truth", self.truth),
            ("robot/state", self.state),
            ("gripper/state", self.gripper),
            ("retarget/status", self.reference),
        )
        return [name for name, part in parts if part is None]


@dataclass
class Timeline:
    """Gathers one episode. Messages may come in any order, and more than once."""

    configure: EpisodeConfigure
    _moments: dict[int, Moment] = field(default_factory=dict[int, Moment])

    def take(self, message: Message) -> None:
        """Put a message where it belongs."""
        step = message.header.step
        match message:
            case RobotState():
                self._take_state(message)
            case StereoFrame():
                self._moment(step).frame = message
            case PolicyAction():
                self._moment(message.for_step).action = message
            case GroundTruth():
                self._moment(step).truth = message
                if step == 0:
                    # The reference starts at the measured pose; the first status comes later.
                    self._moment(0).reference = message.T_world_tool
            case GripperState():
                self._moment(step).gripper = message
            case RetargetStatus():
                self._moment(
                    -(-step // FRAME_TICKS) * FRAME_TICKS
                ).reference = message.T_world_reference
            case _:
                raise TypeError(f"not a message that is recorded: {message!r}")

    def find_gap(self) -> str | None:
        """The first frame of which something is missing, in words."""
        moments = self._frames()
        if not moments:
            return "it has no frame"
        for number, moment in enumerate(moments):
            missing = moment.missing() if moment is not None else ["camera/stereo"]
            if missing:
                return f"frame {number} has no {', no '.join(missing)}"
        return None

    def count_idle(self) -> int:
        """Frames at the start whose action is exactly zero, the fingers left open."""
        moments = self._frames()[:-1]
        return next(
            (n for n, moment in enumerate(moments) if moment is None or not _is_idle(moment)),
            len(moments),
        )

    def rows(self, *, skip: int) -> EpisodeRows:
        """The episode as columns, once there is no gap.

        Args:
            skip: Frames at the start to leave out.
        """
        moments = [moment for moment in self._frames()[skip:] if moment is not None]
        columns = _stack(moments)
        # There is no next set-point; the grasp stays what it is.
        columns["action"][-1] = columns["intended"][-1] = 0.0
        return EpisodeRows(columns)

    def _moment(self, step: int) -> Moment:
        return self._moments.setdefault(step, Moment())

    def _take_state(self, state: RobotState) -> None:
        """Keep the state of each frame; in real time the nearest one, as its own may be lost."""
        step = state.header.step
        past = step % FRAME_TICKS
        if past == 0:
            self._moment(step).state = state
        elif self.configure.mode == "realtime":
            late = past <= FRAME_TICKS // 2
            frame_step = step - past if late else step - past + FRAME_TICKS
            kept = self._moment(frame_step).state
            if kept is None or abs(step - frame_step) < abs(kept.header.step - frame_step):
                self._moment(frame_step).state = state

    def _frames(self) -> list[Moment | None]:
        """One per frame from tick 0 to the last frame that came."""
        last = max((step for step, moment in self._moments.items() if moment.frame), default=-1)
        return [self._moments.get(step) for step in range(0, last + 1, FRAME_TICKS)]


def _is_idle(moment: Moment) -> bool:
    if moment.action is None:
        return False
    step = moment.action.steps[0]
    return not (any(step.translation_m) or any(step.rotation_rad) or step.grasp)


def _stack(moments: list[Moment]) -> dict[str, Rows]:
    """The columns of frames that are complete."""
    frames = [moment.frame for moment in moments if moment.frame]
    steps = [moment.action.steps[0] for moment in moments if moment.action]
    truths = [moment.truth for moment in moments if moment.truth]
    states = [moment.state for moment in moments if moment.state]
    grippers = [moment.gripper for moment in moments if moment.gripper]
    eyes = b"".join(part for frame in frames for part in (frame.left, frame.right))
    shape = (len(frames), 2, frames[0].height, frames[0].width)
    columns: dict[str, Rows] = {
        "images": np.frombuffer(eyes, np.uint8).reshape(shape),
        "action": _floats([[*step.translation_m, *step.rotation_rad] for step in steps]),
        "intended": _floats([_list_meant(step) for step in steps]),
        "grasp": _bytes([step.grasp for step in steps]),
        "tool_pose": _floats([truth.T_world_tool for truth in truths]),
        "reference_pose": _floats([moment.reference for moment in moments if moment.reference]),
        "opening_m": _floats([gripper.opening_m for gripper in grippers]),
        "gripped": _bytes([gripper.gripped for gripper in grippers]),
        "robot_positions": _floats([state.positions for state in states]),
        "frame_step": _steps([frame.header.step for frame in frames]),
        "state_step": _steps([state.header.step for state in states]),
    }
    for name in truths[0].objects:
        columns[object_column(name)] = _floats([truth.objects[name] for truth in truths])
    return columns


def _list_meant(step: ActionStep) -> list[float]:
    motion = step if step.meant is None else step.meant
    return [*motion.translation_m, *motion.rotation_rad]


def _floats(values: list[list[float]] | list[float]) -> Rows:
    return np.array(values, np.float64)


def _bytes(values: list[bool]) -> Rows:
    return np.array(values, np.uint8)


def _steps(values: list[int]) -> Rows:
    return np.array(values, np.int64)
