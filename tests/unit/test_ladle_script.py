"""The ladle's demonstrator, by a perfect hand: no retargeting, no camera, no messages."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from common.calibration.four_bar import CLOSED_RAD, OPEN_RAD
from common.clock import TICK_S
from common.se3 import make_pose, pose_to_wire
from common.tasks.ladle import LadleTask
from common.tasks.task import DemonstratorView, SuccessMonitor, Waypoint
from services.policy.min_jerk import MinJerkSegment
from tests.ladle_world import make_ladle_world, pose, put

task = LadleTask()

ON_ITS_SIDE = np.column_stack([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""Lying with its scoop towards the robot."""


HASTE = 1.8
"""Faster than people are: tests need not wait."""


class Demonstrator:
    """A hand that follows the script exactly."""

    def __init__(self, *, seed: int) -> None:
        self.world = make_ladle_world(seed=seed)
        self.monitor = SuccessMonitor()
        self.done: list[str] = []
        self._script = task.script(np.random.default_rng([seed, 1]))
        self._T_world_tool = self.world.T_world_tool
        self._driver_rad = OPEN_RAD

    def follow(self, *, until: str | None = None) -> bool:
        """Do the waypoints up to one of that name, or all; tell whether the task succeeded."""
        while until is None or self.done[-1:] != [until]:
            waypoint = self._script.next_waypoint(self._look())
            if waypoint is None:
                return self._stay(1.0, grasp=False)
            if self._go(waypoint):
                return True
            self.done.append(waypoint.name)
        return False

    def _look(self) -> DemonstratorView:
        objects = {name: pose(self.world, name) for name in task.objects}
        opening_m = self.world.fingers.opening_m(self.world.data)
        return DemonstratorView(self.world.T_world_tool, objects, opening_m)

    def _go(self, waypoint: Waypoint) -> bool:
        if waypoint.T_world_tool is not None:
            way = MinJerkSegment(
                self._T_world_tool,
                waypoint.T_world_tool,
                speed_m_s=HASTE * waypoint.speed_m_s,
                turn_rad_s=HASTE * waypoint.turn_rad_s,
                period_s=TICK_S,
            )
            for step in range(1, way.steps + 1):
                self._T_world_tool = way.pose(step)
                if self._tick(grasp=waypoint.grasp):
                    return True
        return self._stay(waypoint.wait_s + waypoint.look_s, grasp=waypoint.grasp)

    def _stay(self, time_s: float, *, grasp: bool) -> bool:
        return any(self._tick(grasp=grasp) for _ in range(round(time_s / TICK_S)))

    def _tick(self, *, grasp: bool) -> bool:
        goal_rad = CLOSED_RAD if grasp else OPEN_RAD
        self._driver_rad += max(-TICK_S, min(TICK_S, goal_rad - self._driver_rad))
        self.world.fingers.command([self._driver_rad] * 2, current_limit_a=0.6)
        self.world.servos.command(pose_to_wire(self._T_world_tool), [0.0] * 6)
        self.world.advance(TICK_S)
        return not grasp and self.monitor.update(task.judge(self.world.task_state(grasp=grasp)))


def test_the_demonstrator_has_done_it_only_after_letting_go():
    demonstrator = Demonstrator(seed=1)
    assert not demonstrator.follow(until="correct")
    held = demonstrator.world.task_state(grasp=True)
    assert {"grasp is open", "handle in the case"} <= set(task.judge(held).failed)
    # Not even by saying that it is released.
    said = task.judge(replace(held, grasp=False))
    assert "robot does not touch the ladle" in said.failed
    assert demonstrator.follow()
    assert demonstrator.done.count("close") == 1


def test_a_lost_ladle_is_taken_up_again():
    demonstrator = Demonstrator(seed=0)
    demonstrator.follow(until="lift")
    put(demonstrator.world, "ladle", make_pose(ON_ITS_SIDE, [0.60, 0.0, 0.66]))
    assert demonstrator.follow()
    assert demonstrator.done.count("close") == 2
