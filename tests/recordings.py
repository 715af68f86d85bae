"""Make the recorded demonstrations: `python -m tests.recordings`.

One episode of the expert on the Abstract embodiment, seed 0, all services in this process and
joined by a list of messages. What is kept are the set-points that the expert's actions make.
"""

from __future__ import annotations

import csv
import sys
from collections import deque

from common.messages import (
    EpisodeConfigure,
    EpisodeReady,
    EpisodeResult,
    EpisodeStart,
    GroundTruth,
    Header,
    Message,
    PolicyAction,
)
from common.se3 import apply_differential, pose_from_wire, pose_to_wire
from common.tasks.recording import COLUMNS, PERIOD_S, RECORDINGS_FOLDER, Recording
from services.gripper.reactor import GripperReactor
from services.policy.reactor import PolicyReactor
from services.retarget.reactor import RetargetReactor
from services.sim.reactor import SimReactor

CELL = "recording"


def run_episode(task: str, *, seed: int = 0) -> list[Message]:
    """Every message of one episode, in order."""
    reactors = [
        SimReactor(node=CELL),
        RetargetReactor(node=CELL, robots=["abstract"]),
        GripperReactor(node=CELL),
        PolicyReactor(node=CELL),
    ]
    head = Header(cell=CELL, episode="recording", epoch=1)
    configure = EpisodeConfigure(
        header=head,
        task=task,
        robot="abstract",
        policy="expert",
        seed=seed,
        mode="lockstep",
        nodes={reactor.kind: CELL for reactor in reactors},
    )
    seen: list[Message] = []
    for first in (configure, EpisodeStart(header=head)):
        waiting = deque[Message]([first])
        while waiting:
            message = waiting.popleft()
            seen.append(message)
            for reactor in reactors:
                if isinstance(message, reactor.inputs):
                    answers = reactor.handle([message])
                    waiting.extend(
                        # As a runner does: the cell takes answers of its own nodes only.
                        each.stamped(source=CELL, seq=1, t_mono_ns=0)
                        for each in answers
                        if isinstance(each, Message)
                    )
    return seen


def record(task: str, *, seed: int = 0) -> Recording:
    """The demonstration of one successful episode."""
    messages = run_episode(task, seed=seed)
    problems = [m.problem for m in messages if isinstance(m, EpisodeReady) and m.problem]
    results = [m.result for m in messages if isinstance(m, EpisodeResult)]
    if problems or [result.outcome for result in results] != ["success"]:
        sys.exit(f"no demonstration of {task}: {problems or results}")
    truth = next(m for m in messages if isinstance(m, GroundTruth))
    poses, grasp = [pose_from_wire(truth.T_world_tool)], [False]
    for action in (m for m in messages if isinstance(m, PolicyAction)):
        (step,) = action.steps
        poses.append(apply_differential(poses[-1], step.translation_m, step.rotation_rad))
        grasp.append(step.grasp)
    return Recording(task, tuple(poses), tuple(grasp))


def write(recording: Recording) -> None:
    """Put it where `load_recording` finds it."""
    RECORDINGS_FOLDER.mkdir(exist_ok=True)
    with (RECORDINGS_FOLDER / f"{recording.task}.csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        frames = zip(recording.T_world_setpoint, recording.grasp, strict=True)
        for index, (T_world_setpoint, grasp) in enumerate(frames):
            pose = [f"{value:.9f}" for value in pose_to_wire(T_world_setpoint)]
            writer.writerow([f"{index * PERIOD_S:.1f}", *pose, int(grasp)])


if __name__ == "__main__":
    write(record("lid"))
