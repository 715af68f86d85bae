"""Kinematics of one robot: where the tool is, and how the joints move it."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pinocchio as pin

from common.errors import BadRobotFile
from common.robots import RobotSpec
from common.robots.compile import compile_robot, find_positions
from common.se3 import Array
from services.retarget.level import Mask
from services.retarget.model import build_pinocchio_model


class RobotModel:
    """Kinematics of one robot: loaded once, shared by all cells. Joints of legs are left out.

    Args:
        spec: The robot.

    Raises:
        BadRobotFile: The robot's files do not agree.
        ModelMismatch: Pinocchio's model is not MuJoCo's.
    """

    def __init__(self, spec: RobotSpec) -> None:
        self.spec = spec
        self.mj: mujoco.MjModel = compile_robot(spec)
        if spec.nv < 6:
            problem = f"{spec.nv} joints cannot move a hand freely"
            raise BadRobotFile(spec.name, "joints", problem)
        self.pin: pin.Model = build_pinocchio_model(
            self.mj, robot=spec.name, locked=spec.leg_joints
        )
        self.data: pin.Data = self.pin.createData()
        self._offset: Array = self.mj.qpos0[find_positions(spec, self.mj)]
        self._tool = self.pin.getFrameId(spec.tool_site, pin.FrameType.OP_FRAME)
        self.hand_joints: Mask = self.list_moving(self._tool)
        """(n,) mask of the joints that can move the tool."""
        self.lower: Array = self.pin.lowerPositionLimit + self._offset
        self.upper: Array = self.pin.upperPositionLimit + self._offset

    def compute_tool_pose(self, q: Array) -> Array:
        """T_world_tool (4, 4) at joint positions q (n,)."""
        pin.forwardKinematics(self.pin, self.data, q - self._offset)
        return pin.updateFramePlacement(self.pin, self.data, self._tool).homogeneous

    def compute_hand(self, q: Array) -> tuple[Array, Array]:
        """T_world_tool (4, 4) and the hand Jacobian (6, n) in world axes at the tool."""
        J = pin.computeFrameJacobian(
            self.pin, self.data, q - self._offset, self._tool, pin.LOCAL_WORLD_ALIGNED
        )
        T = pin.updateFramePlacement(self.pin, self.data, self._tool).homogeneous
        return T, J

    def find_site(self, name: str) -> int:
        """Frame of a site.

        Raises:
            BadRobotFile: There is none of this name.
        """
        if not self.pin.existFrame(name, pin.FrameType.OP_FRAME):
            raise BadRobotFile(self.spec.name, f"site {name}", "is missing in model.xml")
        return self.pin.getFrameId(name, pin.FrameType.OP_FRAME)

    def compute_site(self, frame: int) -> tuple[Array, Array]:
        """Pose (4, 4) and Jacobian (6, n) of a site at the joint positions of `update`."""
        J = pin.getFrameJacobian(self.pin, self.data, frame, pin.LOCAL_WORLD_ALIGNED)
        return self.data.oMf[frame].homogeneous, J

    def update(self, q: Array) -> None:
        """Compute all frames and joint Jacobians at joint positions q (n,)."""
        pin.computeJointJacobians(self.pin, self.data, q - self._offset)
        pin.updateFramePlacements(self.pin, self.data)

    def list_moving(self, frame: int) -> Mask:
        """(n,) mask of the joints that can move a frame."""
        mask = np.zeros(self.pin.nv, dtype=bool)
        for joint in self.pin.supports[self.pin.frames[frame].parentJoint]:
            if joint:
                mask[self.pin.joints[joint].idx_v] = True
        return mask

    def place_geom(self, name: str) -> tuple[int, Any]:
        """Joint that carries a geom of model.xml (0: the world), and the geom's pose in it.

        Args:
            name: Of the geom.
        """
        geom = self.mj.geom(name)
        body = self.mj.body(int(self.mj.geom_bodyid[geom.id])).name
        frame = self.pin.frames[self.pin.getFrameId(str(body), pin.FrameType.BODY)]
        w, x, y, z = self.mj.geom_quat[geom.id]
        local = pin.SE3(pin.Quaternion(w, x, y, z).matrix(), self.mj.geom_pos[geom.id])
        return int(frame.parentJoint), frame.placement * local
