"""Every robot with simulation, retargeter, gripper and expert: it does the task and holds still."""

from __future__ import annotations

from unittest.mock import patch

import numpy as np
import pytest

from common.robots import list_robots, load_robot
from common.se3 import distance
from tests.retarget_runs import step
from tests.robot_loop import hold, run_lid

APPROACH = [step([0.01, 0.01, 0.015], [0.02, 0.03, -0.02])] * 10
"""One second of motion into free space, so that the robot does not hold its start alone."""
SETTLED, END = 1000, 6000
"""Ticks at 10 s and 60 s."""
BASES = {"spot": 6, "google": 3}
"""Coordinates that move the whole robot come first."""


@pytest.mark.parametrize("robot", list_robots())
def test_every_robot_closes_the_lid_and_follows_the_gripper(robot: str):
    result = run_lid(robot)
    assert result.outcome == "success", result.reason
    assert result.hand_error_m.median <= 0.005
    assert result.hand_error_m.p95 <= 0.015
    assert result.solver_failures == 0
    assert 0.5 < result.hand_scaling_mean <= 1.0


@pytest.mark.long
@pytest.mark.parametrize("robot", list_robots())
def test_every_robot_holds_still_for_a_minute(robot: str):
    legs = load_robot(robot).legs
    positions, tools, feet = [], [], []
    for world in hold(robot, APPROACH, ticks=END):
        positions.append(world.servos.positions(world.data))
        tools.append(world.T_world_tool)
        if legs:
            sites = [world.model.site(f"robot_{leg.foot_site}").id for leg in legs]
            feet.append(world.data.site_xpos[sites])
    moved_m, _ = distance(tools[0], tools[SETTLED])
    assert moved_m > 0.15
    drift = np.array([distance(tools[SETTLED], T) for T in tools[SETTLED:]])
    assert drift.max() < 0.5e-3
    assert np.ptp([T[:3, 3] for T in tools[SETTLED:]], axis=0).max() < 0.5e-3
    if robot in BASES:
        base = np.array(positions)[SETTLED:, : BASES[robot]]
        assert np.ptp(base, axis=0).max() < 0.5e-3
    if legs:
        footholds = np.array([leg.foothold for leg in legs])
        assert np.linalg.norm(feet - footholds, axis=-1).max() < 1e-3


def test_a_robot_with_command_latency_follows_as_well():
    late = load_robot("panda").model_copy(update={"command_latency_s": 0.03})
    with (
        patch("services.sim.reactor.load_robot", lambda _: late),
        patch("services.retarget.reactor.load_robot", lambda _: late),
    ):
        result = run_lid("panda")
    assert result.outcome == "success", result.reason
    assert result.hand_error_m.median < 0.002
    assert result.hand_error_m.p95 < 0.005
