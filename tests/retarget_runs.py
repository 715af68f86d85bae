"""What the retargeter's tests share: references to follow and messages of one episode."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from typing import Literal

import numpy as np

from common.messages import (
    ActionStep,
    EpisodeAbort,
    EpisodeConfigure,
    Header,
    Mode,
    PolicyAction,
    RobotState,
)
from common.robots import list_robots, load_robot
from common.se3 import Array, exp3, make_pose
from services.retarget.reference import GripperReference, TickReference
from services.retarget.robot_model import RobotModel
from services.retarget.whole_body import WholeBodyRetargeter

CELL = "cell-1"
NODE = "retarget-test"


BODIES = [name for name in list_robots() if load_robot(name).kind == "joints"]
"""Robots with joints."""


@functools.cache
def robot_model(name: str, mode: Literal["project", "scale"] = "project") -> RobotModel:
    """A robot's kinematics, built once."""
    spec = load_robot(name)
    gains = spec.retarget.model_copy(update={"mode": mode})
    return RobotModel(spec.model_copy(update={"retarget": gains}))


def make_retargeter(name: str) -> WholeBodyRetargeter:
    """A robot at its start posture."""
    return WholeBodyRetargeter(robot_model(name))


def make_panda() -> WholeBodyRetargeter:
    """A Panda at its start posture."""
    return make_retargeter("panda")


def step(translation_m: Sequence[float] = (0, 0, 0), rotation_rad: Sequence[float] = (0, 0, 0)):
    """One action step."""
    return ActionStep(
        translation_m=[float(v) for v in translation_m],
        rotation_rad=[float(v) for v in rotation_rad],
        grasp=False,
    )


def rest(T: Array) -> TickReference:
    """A reference that stands still."""
    return TickReference(T, T, np.zeros(6))


def jumping_references(random: np.random.Generator, ticks: int) -> Iterator[TickReference]:
    """Targets anywhere around the robot that jump every 1 to 80 ticks, with wild feed-forward."""
    until = 0
    reference = rest(np.eye(4))
    for tick in range(ticks):
        if tick >= until:
            until = tick + int(random.integers(1, 80))
            R = exp3(random.normal(size=3) * random.choice([0.1, 1.0, 3.0]))
            T = make_pose(R, random.uniform([-0.8, -0.8, 0.0], [1.0, 0.8, 1.8]))
            twist = random.normal(size=6) * random.choice([0.0, 0.5, 5.0])
            reference = TickReference(T, T, twist)
        yield reference


def wandering_actions(count: int) -> Iterator[ActionStep]:
    """A smooth tour through the workspace: sums of slow sinusoids, 10 Hz."""
    phases = 2 * np.pi * np.arange(count) * 0.1
    for phase in phases:
        yield step(
            [0.02 * np.sin(0.3 * phase), 0.02 * np.cos(0.21 * phase), 0.01 * np.sin(0.4 * phase)],
            [0.0, 0.04 * np.sin(0.3 * phase), 0.05 * np.cos(0.21 * phase)],
        )


def follow_actions(
    retargeter: WholeBodyRetargeter, actions: Sequence[ActionStep], positions: Sequence[float]
) -> Iterator[tuple[TickReference, Array]]:
    """Follow actions of 10 Hz; give reference and commanded positions of every tick."""
    reference = GripperReference(retargeter.compute_tool_pose(positions), lead=None)
    retargeter.start(positions)
    for action in actions:
        reference.take([action])
        for _ in range(10):
            tick = reference.advance()
            yield tick, np.array(retargeter.follow(tick).positions)


SIM, POLICY = "sim-1", "policy-1"
"""Nodes that the retargeter listens to."""


def header(tick: int = 0, epoch: int = 1, *, source: str = SIM) -> Header:
    """Header of the test cell at a tick."""
    return Header(
        cell=CELL,
        episode=f"episode-{epoch}",
        epoch=epoch,
        source=source,
        step=tick,
        t_sim_s=0.01 * tick,
        t_mono_ns=1000 + tick,
    )


def configure(
    robot: str = "panda", *, mode: Mode = "lockstep", node: str = NODE, epoch: int = 1
) -> EpisodeConfigure:
    """The start of an episode that `node` retargets."""
    return EpisodeConfigure(
        header=header(epoch=epoch),
        task="lid",
        robot=robot,
        policy="expert",
        seed=0,
        mode=mode,
        nodes={"sim": SIM, "retarget": node, "policy": POLICY},
    )


def state(
    tick: int, robot: str = "panda", *, due: int = -1, epoch: int = 1, positions=None
) -> RobotState:
    """The robot at its start, or at given positions."""
    spec = load_robot(robot)
    return RobotState(
        header=header(tick, epoch),
        positions=spec.start_positions if positions is None else positions,
        velocities=[0.0] * spec.nv,
        due_frame_step=due,
    )


def action(for_step: int, *steps: ActionStep, epoch: int = 1) -> PolicyAction:
    """An action of the policy; one centimetre forward unless told."""
    return PolicyAction(
        header=header(for_step, epoch, source=POLICY),
        for_step=for_step,
        request_t_mono_ns=0,
        steps=list(steps) or [step([0.01, 0, 0])],
        inference_s=0.0,
    )


def abort(epoch: int = 1) -> EpisodeAbort:
    """The end of the episode."""
    return EpisodeAbort(header=header(epoch=epoch), reason="test")
