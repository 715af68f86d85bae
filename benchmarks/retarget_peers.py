"""Retargeters of other projects behind one interface: Pink and mink, each as its manual has it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, TypeAlias

import numpy as np
import pink
import pinocchio as pin
from pink.exceptions import PinkError
from pink.limits import AccelerationLimit, ConfigurationLimit, VelocityLimit
from pink.tasks import FrameTask, PostureTask

from common.clock import TICK_S
from common.robots import RobotSpec
from common.se3 import Array
from services.retarget.reference import TickReference
from services.retarget.robot_model import RobotModel

INSTALL_MINK = "pip install --no-deps mink==1.3.0"
"""Without dependencies: it asks for the package mujoco, which overwrites mujoco-core's files."""

POSTURE_COST = 1e-3


Vector: TypeAlias = Sequence[float] | Array


class Follower(Protocol):
    """A retargeter that integrates its own command."""

    failures: int
    """Levels or programs without solution so far."""

    def step(self, reference: TickReference) -> tuple[Vector, Vector]:
        """One tick: positions (n,) at its end and velocities (n,) [rad, m, rad/s, m/s]."""
        ...


class PinkPeer:
    """Pink with position, velocity and its opt-in acceleration limits.

    Position and orientation cost in the same ratio as ours; gain 1 and no damping, as its class has
    by default. The posture has a small cost and the gain of our own posture level. After a tick
    without solution the robot is held and Pink told so; otherwise its acceleration limit stays
    infeasible.

    Args:
        model: The robot.
        solver: Name of a solver in qpsolvers.
    """

    def __init__(self, model: RobotModel, *, solver: str) -> None:
        spec = model.spec
        # Pink keeps attributes of its own on the model.
        self._model = pin.Model(model.pin)
        self._model.velocityLimit = _velocity_limits(spec)
        self._solver = solver
        self._q = np.array(spec.start_positions)
        self._rest = np.zeros(spec.nv)
        self._configuration = pink.Configuration(self._model, self._model.createData(), self._q)
        self._hand = FrameTask(
            spec.tool_site,
            position_cost=1.0,
            orientation_cost=spec.retarget.rotation_scale_m,
        )
        posture = PostureTask(cost=POSTURE_COST, gain=spec.retarget.posture_gain_per_s * TICK_S)
        posture.set_target(_bias(spec))
        self._tasks = [self._hand, posture]
        self._acceleration = AccelerationLimit(
            self._model, np.array([joint.acceleration_limit for joint in spec.joints])
        )
        self._limits = [
            ConfigurationLimit(self._model, config_limit_gain=0.5),
            VelocityLimit(self._model),
            self._acceleration,
        ]
        self.failures = 0

    def step(self, reference: TickReference) -> tuple[Array, Array]:
        """One tick, as in `Follower`; only the pose is used."""
        self._hand.set_target(pin.SE3(reference.T_world_start))
        try:
            v = pink.solve_ik(
                self._configuration,
                self._tasks,
                TICK_S,
                solver=self._solver,
                limits=self._limits,
                safety_break=False,
            )
        except PinkError:
            v = self._rest
            self.failures += 1
        self._acceleration.set_last_integration(v, TICK_S)
        self._configuration.integrate_inplace(v, TICK_S)
        return self._configuration.q, v


class MinkPeer:
    """mink with position and velocity limits. It has no acceleration limits.

    Args:
        model: The robot.
        solver: Name of a solver in qpsolvers.

    Raises:
        ImportError: mink is not installed.
    """

    def __init__(self, model: RobotModel, *, solver: str) -> None:
        # Not one of our dependencies (INSTALL_MINK), so it may be missing.
        import mink

        spec = model.spec
        self._mink: Any = mink
        self._solver = solver
        self._rest = np.zeros(spec.nv)
        self._configuration: Any = mink.Configuration(model.mj, np.array(spec.start_positions))
        self._hand: Any = mink.FrameTask(
            spec.tool_site,
            "site",
            position_cost=1.0,
            orientation_cost=spec.retarget.rotation_scale_m,
        )
        gain = spec.retarget.posture_gain_per_s * TICK_S
        posture = mink.PostureTask(model.mj, cost=POSTURE_COST, gain=gain)
        posture.set_target(_bias(spec))
        self._tasks = [self._hand, posture]
        velocities = {joint.name: joint.velocity_limit for joint in spec.joints}
        self._limits = [
            mink.ConfigurationLimit(model.mj),
            mink.VelocityLimit(model.mj, velocities),
        ]
        self.failures = 0

    def step(self, reference: TickReference) -> tuple[Array, Array]:
        """One tick, as in `Follower`; only the pose is used."""
        self._hand.set_target(self._mink.SE3.from_matrix(reference.T_world_start))
        try:
            v = self._mink.solve_ik(
                self._configuration, self._tasks, TICK_S, self._solver, limits=self._limits
            )
        except self._mink.NoSolutionFound:
            v = self._rest
            self.failures += 1
        self._configuration.integrate_inplace(v, TICK_S)
        return self._configuration.q, v


def _velocity_limits(spec: RobotSpec) -> Array:
    return np.array([joint.velocity_limit for joint in spec.joints])


def _bias(spec: RobotSpec) -> Array:
    return np.array([joint.bias for joint in spec.joints])
