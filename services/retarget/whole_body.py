"""The retargeter of a robot with joints: task, bounds, hierarchy, integration."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from common.clock import TICK_S
from common.errors import BadRobotFile
from common.robots import RobotSpec
from common.robots.compile import compile_robot
from common.se3 import Array
from services.retarget.bounds import Box, JointBounds, JointLimits
from services.retarget.hand_task import compute_hand_twist
from services.retarget.hierarchy import Hierarchy
from services.retarget.model import build_pinocchio_model
from services.retarget.reference import TickReference
from services.retarget.retargeter import Motion

_AT_BOUND = 1e-6


class RobotModel:
    """Kinematics of one robot: loaded once, shared by all cells.

    Raises:
        BadRobotFile: The robot's files do not agree.
        ModelMismatch: Pinocchio's model is not MuJoCo's.
    """

    def __init__(self, spec: RobotSpec) -> None:
        self.spec = spec
        mj = compile_robot(spec)
        if mj.nv < 6:
            raise BadRobotFile(spec.name, "joints", f"{mj.nv} joints cannot move a hand freely")
        self._model = build_pinocchio_model(mj, robot=spec.name)
        self._data = self._model.createData()
        self._frame = self._model.getFrameId(spec.tool_site, pin.FrameType.OP_FRAME)
        self._offset = mj.qpos0.copy()
        self.lower: Array = self._model.lowerPositionLimit + self._offset
        self.upper: Array = self._model.upperPositionLimit + self._offset

    def compute_tool_pose(self, q: Array) -> Array:
        """T_world_tool (4, 4) at joint positions q (n,)."""
        pin.forwardKinematics(self._model, self._data, q - self._offset)
        return pin.updateFramePlacement(self._model, self._data, self._frame).homogeneous

    def compute_hand(self, q: Array) -> tuple[Array, Array]:
        """T_world_tool (4, 4) and the hand Jacobian (6, n) in world axes at the tool."""
        J = pin.computeFrameJacobian(
            self._model, self._data, q - self._offset, self._frame, pin.LOCAL_WORLD_ALIGNED
        )
        T = pin.updateFramePlacement(self._model, self._data, self._frame).homogeneous
        return T, J


class WholeBodyRetargeter:
    """Follows with all joints, under position, velocity and acceleration limits.

    It integrates its command, q+ = q + a dt: that is what the bounds' guarantees hold for, and what
    keeps servo errors from becoming hand errors.

    Args:
        model: The robot's kinematics.
    """

    def __init__(self, model: RobotModel) -> None:
        joints = model.spec.joints
        self._model = model
        self._gains = model.spec.retarget
        self._names = [joint.name for joint in joints]
        self._bias = np.array([joint.bias for joint in joints])
        self._H = np.array([joint.level1_weight for joint in joints])
        self._W = np.array([joint.level2_weight for joint in joints])
        self._bounds = JointBounds(
            [
                JointLimits(lower, upper, joint.velocity_limit, joint.acceleration_limit)
                for joint, lower, upper in zip(
                    joints, model.lower.tolist(), model.upper.tolist(), strict=True
                )
            ],
            dt_s=TICK_S,
        )
        self.start([joint.start for joint in joints])

    def compute_tool_pose(self, positions: Sequence[float]) -> Array:
        """T_world_tool (4, 4) at measured joint positions."""
        return self._model.compute_tool_pose(np.array(positions))

    def start(self, positions: Sequence[float]) -> None:
        """Begin at the measured positions, at rest, with solvers that remember nothing."""
        self._q = np.array(positions)
        self._a = np.zeros(len(self._names))
        self._hierarchy = Hierarchy(
            H=self._H, W=self._W, rotation_scale_m=self._gains.rotation_scale_m
        )

    def follow(self, reference: TickReference) -> Motion:
        """Plan one tick and integrate it."""
        T_world_hand, J1 = self._model.compute_hand(self._q)
        x1 = compute_hand_twist(
            T_world_hand, reference.T_world_start, reference.twist, self._gains, TICK_S
        )
        x2 = self._gains.posture_gain_per_s * (self._bias - self._q)
        box = self._bounds.compute(self._q.tolist(), self._a.tolist())
        solution = self._hierarchy.solve(J1, x1, x2, self._a, box)
        self._a = solution.a
        self._q = self._q + TICK_S * solution.a
        velocities: list[float] = self._a.tolist()
        return Motion(
            positions=self._q.tolist(),
            velocities=velocities,
            scaling=list(solution.scaling),
            active_limits=self._list_active(velocities, box),
            failures=solution.failures,
        )

    def _list_active(self, velocities: list[float], box: Box) -> list[str]:
        return [
            name
            for name, a, least, most in zip(
                self._names, velocities, box.lower, box.upper, strict=True
            )
            if a <= least + _AT_BOUND or a >= most - _AT_BOUND
        ]
