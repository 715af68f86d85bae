"""Legs in the simulation: they follow the body, carry nothing and touch nothing."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np

from common.robots import RobotSpec
from common.robots.compile import compile_robot
from common.robots.leg import Leg, read_legs
from common.se3 import Quaternion


class Legs:
    """Bends the legs once per tick, so that every foot stands on its foothold.

    In the world their links are fixed to the body, and it is the model that is changed, the turn of
    each link in its parent: where they are follows from the body alone. As joints of the world they
    would move by themselves between ticks, and cost a third of a physics step.

    Args:
        model: Compiled world, built with `fix`.
        robot: The robot in it, perhaps one without legs.
    """

    def __init__(self, model: Any, robot: RobotSpec) -> None:
        self._model = model
        self._legs: tuple[Leg, ...] = ()
        self._links = np.zeros(0, dtype=int)
        if robot.legs:
            # Read from the robot alone, where legs have joints and names no prefix.
            alone: Any = compile_robot(robot)
            self._legs = read_legs(alone, robot)
            links = [alone.body(alone.joint(name).bodyid[0]).name for name in robot.leg_joints]
            self._links = np.array([model.body(f"robot_{name}").id for name in links])
        self._bodies = [int(model.body_parentid[hip]) for hip in self._links[::3]]

    @staticmethod
    def fix(spec: Any, robot: RobotSpec) -> None:
        """Take the joints of the legs out of a world."""
        for name in robot.leg_joints:
            spec.delete(spec.joint(f"robot_{name}"))

    def follow(self, data: Any) -> None:
        """Put the feet on their footholds.

        Args:
            data: State, with the poses that belong to it; the legs' are brought up to date.

        Raises:
            FootholdOutOfReach: The body is where a foot cannot stand on its foothold.
        """
        if not self._legs:
            return
        quats: list[Quaternion] = []
        for leg, body in zip(self._legs, self._bodies, strict=True):
            roll, pitch, knee = leg.solve(data.xpos[body], data.xmat[body].reshape(3, 3))
            quats += [_about_x(roll), _about_y(pitch), _about_y(knee)]
        self._model.body_quat[self._links] = quats
        mujoco.mj_kinematics(self._model, data)


def _about_x(angle_rad: float) -> Quaternion:
    return math.cos(0.5 * angle_rad), math.sin(0.5 * angle_rad), 0.0, 0.0


def _about_y(angle_rad: float) -> Quaternion:
    return math.cos(0.5 * angle_rad), 0.0, math.sin(0.5 * angle_rad), 0.0
