"""Robots in the loop for tests: all services in one thread, joined by a list of messages."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from typing import Any
from unittest.mock import patch

from common.calibration import StereoCalibration
from common.clock import TICK_S
from common.messages import (
    ActionStep,
    EpisodeConfigure,
    EpisodeResult,
    EpisodeStart,
    Header,
    Message,
    RobotCommand,
    RobotState,
    TrialResult,
)
from common.robots import load_robot
from common.tasks import load_task
from services.gripper.reactor import GripperReactor
from services.policy.reactor import PolicyReactor
from services.retarget.reactor import RetargetReactor
from services.sim.reactor import SimReactor
from services.sim.world import World
from tests.retarget_runs import NODE, action, configure, header

CELL = "loop"


class BlindCamera:
    """Black pictures, for policies that look at the truth alone: ray tracing takes longest."""

    def __init__(self, model: Any, calibration: StereoCalibration, **options: object) -> None:
        self._eye = bytes(calibration.width * calibration.height)

    def render(self, data: Any) -> tuple[bytes, bytes]:
        return self._eye, self._eye


def run_lid(robot: str, *, seed: int = 0) -> TrialResult:
    """One lid episode by the scripted expert, which looks at the truth and not at the pictures."""
    with patch("services.sim.reactor.StereoCamera", BlindCamera):
        *_, last = _exchange(robot, seed)
    assert isinstance(last, EpisodeResult), last
    return last.result


def _exchange(robot: str, seed: int) -> Iterator[Message]:
    """Every message of one episode, in order."""
    reactors = [
        SimReactor(node=CELL),
        RetargetReactor(node=CELL, robots=[robot]),
        GripperReactor(node=CELL),
        PolicyReactor(node=CELL),
    ]
    head = Header(cell=CELL, episode="loop", epoch=1)
    first = EpisodeConfigure(
        header=head,
        task="lid",
        robot=robot,
        policy="expert",
        seed=seed,
        mode="lockstep",
        nodes={reactor.kind: CELL for reactor in reactors},
    )
    for control in (first, EpisodeStart(header=head)):
        waiting = deque[Message]([control])
        while waiting:
            message = waiting.popleft()
            yield message
            for reactor in reactors:
                if isinstance(message, reactor.inputs):
                    answers = reactor.handle([message])
                    waiting.extend(
                        # As a runner does: the cell takes answers of its own nodes only.
                        each.stamped(source=CELL, seq=1, t_mono_ns=0)
                        for each in answers
                        if isinstance(each, Message)
                    )


def hold(robot: str, steps: Sequence[ActionStep], *, ticks: int) -> Iterator[World]:
    """A world in which the set-point makes some steps and then stays; given after every tick."""
    world = World(task=load_task("lid"), robot=load_robot(robot), seed=0)
    reactor = RetargetReactor(node=NODE, robots=[robot])
    reactor.handle([configure(robot), action(0, *steps)])
    for tick in range(ticks):
        state = RobotState(
            header=header(tick),
            positions=world.servos.positions(world.data),
            velocities=world.servos.velocities(world.data),
            due_frame_step=-1 if tick else 0,
        )
        *_, command = reactor.handle([state])
        assert isinstance(command, RobotCommand)
        world.servos.command(command.positions, command.velocities)
        world.advance(TICK_S)
        yield world
