"""Kinematics: Pinocchio against MuJoCo on every body, and the tool's Jacobian."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin

from common.se3 import Array
from services.retarget.check.postures import draw_posture
from services.retarget.check.report import Finding, Value, judge
from services.retarget.model import POSE_TOLERANCE, joint_ranges

POSTURES = 100


@dataclass
class _Largest:
    """The largest difference so far, and where."""

    difference: float = 0.0
    where: str = ""

    def take(self, a: Array, b: Array, where: str) -> None:
        difference = float(np.abs(a - b).max())
        # Nothing is worse than not a number, and no comparison with it holds.
        if not difference <= self.difference and not math.isnan(self.difference):
            self.difference, self.where = difference, where


def check_kinematics(mj: mujoco.MjModel, whole: Any, *, tool_site: str) -> list[Finding]:
    """Compare both models of a robot over random postures.

    Args:
        mj: Compiled model of the robot, alone.
        whole: Pinocchio model of it, legs included.
        tool_site: Site of the tool frame.

    Returns:
        The largest difference of the bodies' positions and rotations, and of the tool's Jacobian
        J = [J_p; J_R] (6, n) in world axes, against MuJoCo's `mj_jacSite`.
    """
    positions, rotations, jacobian = _Largest(), _Largest(), _Largest()
    data, mj_data = whole.createData(), mujoco.MjData(mj)
    names = [str(mj.body(body).name) for body in range(mj.nbody)]
    frames = [whole.getFrameId(name, pin.FrameType.BODY) for name in names[1:]]
    tool, site = whole.getFrameId(tool_site, pin.FrameType.OP_FRAME), mj.site(tool_site).id
    lower, upper = joint_ranges(mj)
    random = np.random.default_rng(1)
    for _ in range(POSTURES):
        q = draw_posture(lower, upper, random)
        mj_data.qpos[:] = q + mj.qpos0
        mujoco.mj_kinematics(mj, mj_data)
        mujoco.mj_comPos(mj, mj_data)
        J = pin.computeFrameJacobian(whole, data, q, tool, pin.LOCAL_WORLD_ALIGNED)
        J_mj = np.zeros((6, mj.nv))
        mujoco.mj_jacSite(mj, mj_data, J_mj[:3], J_mj[3:], site)
        jacobian.take(J, J_mj, f"column of {_worst_joint(mj, J - J_mj)}")
        pin.framesForwardKinematics(whole, data, q)
        for body, frame in enumerate(frames, start=1):
            pose = data.oMf[frame]
            positions.take(pose.translation, mj_data.xpos[body], names[body])
            rotations.take(pose.rotation, mj_data.xmat[body].reshape(3, 3), names[body])
    return [
        _tell("positions", positions, f"{mj.nbody - 1} bodies", " m"),
        _tell("rotations", rotations, f"{mj.nbody - 1} bodies", ""),
        _tell("Jacobian", jacobian, f"the tool, {mj.nv} joints", ""),
    ]


def _worst_joint(mj: mujoco.MjModel, difference: Array) -> str:
    return str(mj.joint(int(np.abs(difference).max(axis=0).argmax())).name)


def _tell(name: str, largest: _Largest, what: str, unit: str) -> Finding:
    good = largest.difference <= POSE_TOLERANCE
    text = f"{what}: Pinocchio and MuJoCo differ by at most {largest.difference:.1e}{unit}"
    if not good:
        text += f" ({largest.where}), allowed {POSE_TOLERANCE:.0e}"
    values: dict[str, Value] = {"difference": largest.difference, "postures": POSTURES}
    return Finding(group="kinematics", name=name, status=judge(good), text=text, values=values)
