"""Legs in the simulation: they follow the body, carry nothing and touch nothing."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from common.robots import RobotSpec
from common.robots.compile import compile_robot
from common.robots.leg import read_legs
from common.se3 import Array


class Legs:
    """Sets the leg joints once per tick, so that every foot stands on its foothold.

    Between ticks the joints go on with the velocity they were given. They are joints of the world,
    not shapes that are bent from outside, so that its state says all about the robot's looks.

    Args:
        model: Compiled world.
        robot: The robot in it, perhaps one without legs.
    """

    def __init__(self, model: Any, robot: RobotSpec) -> None:
        self._model = model
        # The geometry is read from the robot alone, where the joints have the names of robot.toml.
        self._legs = read_legs(compile_robot(robot), robot) if robot.legs else ()
        joints = [model.joint(f"robot_{name}") for name in robot.leg_joints]
        self._qpos = np.array([int(joint.qposadr[0]) for joint in joints], dtype=int)
        self._dof = np.array([int(joint.dofadr[0]) for joint in joints], dtype=int)
        hips = [int(joint.bodyid[0]) for joint in joints[::3]]
        self._bodies = [int(model.body_parentid[hip]) for hip in hips]
        self._angles = np.zeros(len(joints))

    def reset(self, data: Any) -> None:
        """Put the feet on their footholds, the legs at rest. Brings all poses up to date."""
        if self._legs:
            mujoco.mj_kinematics(self._model, data)
            self._place(data)
            data.qvel[self._dof] = 0.0

    def follow(self, data: Any, dt_s: float) -> None:
        """Put the feet back on their footholds after the body has moved.

        Args:
            data: State, with the poses that belong to it; the legs' are brought up to date.
            dt_s: Time since the feet were placed last.

        Raises:
            FootholdOutOfReach: The body is where a foot cannot stay on its foothold.
        """
        if self._legs:
            before = self._angles
            self._place(data)
            data.qvel[self._dof] = (self._angles - before) / dt_s

    def _place(self, data: Any) -> None:
        self._angles: Array = np.array(
            [
                angle
                for leg, body in zip(self._legs, self._bodies, strict=True)
                for angle in leg.solve(data.xpos[body], data.xmat[body].reshape(3, 3))
            ]
        )
        data.qpos[self._qpos] = self._angles
        mujoco.mj_kinematics(self._model, data)
