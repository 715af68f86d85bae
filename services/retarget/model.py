"""The kinematic model: Pinocchio's, built from the compiled MuJoCo model of the same robot."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin

from common.errors import BadRobotFile, ModelMismatch
from common.se3 import Array

POSE_TOLERANCE = 1e-9
GUARD_POSES = 20

_JOINT_MAKERS = {
    int(mujoco.mjtJoint.mjJNT_HINGE): pin.JointModelRevoluteUnaligned,
    int(mujoco.mjtJoint.mjJNT_SLIDE): pin.JointModelPrismaticUnaligned,
}


def build_pinocchio_model(
    mj: mujoco.MjModel, *, robot: str, locked: Collection[str] = ()
) -> pin.Model:
    """Build the Pinocchio model of a compiled MuJoCo model that holds one robot, and check it.

    Body b with last joint id_b has the pose M_b in that joint's frame. For bodies in model order:
    M = M_parent (R(body_quat), body_pos); each joint j is added at M (I, jnt_pos) and leaves
    M = (I, -jnt_pos); the inertia is appended at M; bodies and sites become frames.
    Joint values agree as q = qpos - qpos0.

    Args:
        mj: Compiled model with hinges and slides only.
        robot: For error messages.
        locked: Joints that are left out; they stay at their reference position.

    Raises:
        BadRobotFile: A joint is neither hinge nor slide.
        ModelMismatch: The two models do not agree.
    """
    model = _assemble(mj, robot, ())
    check_agreement(model, mj, robot=robot)
    return _assemble(mj, robot, locked) if locked else model


def _assemble(mj: mujoco.MjModel, robot: str, locked: Collection[str]) -> pin.Model:
    model = pin.Model()
    model.name = robot
    joint_of = [0] * mj.nbody
    M_of = [pin.SE3.Identity()] * mj.nbody
    for body in range(1, mj.nbody):
        parent = int(mj.body_parentid[body])
        placement = M_of[parent] * _se3(mj.body_quat[body], mj.body_pos[body])
        joint = joint_of[parent]
        for j in range(mj.body_jntadr[body], mj.body_jntadr[body] + mj.body_jntnum[body]):
            if _name(mj, "joint", j) in locked:
                continue
            offset = pin.SE3(np.eye(3), mj.jnt_pos[j])
            joint = model.addJoint(
                joint, _make_joint(mj, j, robot), placement * offset, _name(mj, "joint", j)
            )
            placement = offset.inverse()
        joint_of[body], M_of[body] = joint, placement
        model.appendBodyToJoint(joint, _inertia(mj, body), placement)
        _add_frame(model, _name(mj, "body", body), joint, placement, pin.FrameType.BODY)
    for site in range(mj.nsite):
        body = int(mj.site_bodyid[site])
        placement = M_of[body] * _se3(mj.site_quat[site], mj.site_pos[site])
        _add_frame(
            model, _name(mj, "site", site), joint_of[body], placement, pin.FrameType.OP_FRAME
        )
    free = [j for j in range(mj.njnt) if _name(mj, "joint", j) not in locked]
    lower, upper = joint_ranges(mj)
    model.lowerPositionLimit, model.upperPositionLimit = lower[free], upper[free]
    model.armature = mj.dof_armature[free]
    model.damping = mj.dof_damping[free]
    return model


def check_agreement(model: pin.Model, mj: mujoco.MjModel, *, robot: str) -> None:
    """Compare size, mass, ranges and all body poses over random joint positions.

    Raises:
        ModelMismatch: Something differs; says what and by how much.
    """
    if model.nq != mj.nq:
        raise ModelMismatch(robot, "number of joint positions", abs(model.nq - mj.nq), 0)
    lower, upper = joint_ranges(mj)
    mass = sum(inertia.mass for inertia in model.inertias)
    _require(robot, "total mass", mass - float(mj.body_mass[1:].sum()))
    _require(robot, "lower joint limit", _difference(model.lowerPositionLimit, lower))
    _require(robot, "upper joint limit", _difference(model.upperPositionLimit, upper))
    data, mj_data = model.createData(), mujoco.MjData(mj)
    # Frames of one name exist as body and as site.
    frames = [
        model.getFrameId(_name(mj, "body", body), pin.FrameType.BODY) for body in range(1, mj.nbody)
    ]
    random = np.random.default_rng(0)
    for _ in range(GUARD_POSES):
        q = random.uniform(np.maximum(lower, -np.pi), np.minimum(upper, np.pi))
        mj_data.qpos[:] = q + mj.qpos0
        mujoco.mj_kinematics(mj, mj_data)
        pin.framesForwardKinematics(model, data, q)
        for body, frame in enumerate(frames, start=1):
            pose = data.oMf[frame]
            name = _name(mj, "body", body)
            _require(
                robot, f"position of {name}", _difference(pose.translation, mj_data.xpos[body])
            )
            R = mj_data.xmat[body].reshape(3, 3)
            _require(robot, f"rotation of {name}", _difference(pose.rotation, R))


def joint_ranges(mj: mujoco.MjModel) -> tuple[Array, Array]:
    """Lower and upper limit of every joint (n,) [rad, m], infinite where there is none."""
    limited = mj.jnt_limited.astype(bool)
    lower = np.where(limited, mj.jnt_range[:, 0] - mj.qpos0, -np.inf)
    upper = np.where(limited, mj.jnt_range[:, 1] - mj.qpos0, np.inf)
    return lower, upper


def _make_joint(mj: mujoco.MjModel, j: int, robot: str) -> Any:
    maker = _JOINT_MAKERS.get(int(mj.jnt_type[j]))
    if maker is None:
        raise BadRobotFile(robot, f"joint {_name(mj, 'joint', j)}", "is neither hinge nor slide")
    return maker(mj.jnt_axis[j])


def _inertia(mj: mujoco.MjModel, body: int) -> pin.Inertia:
    R = _se3(mj.body_iquat[body], mj.body_ipos[body]).rotation
    return pin.Inertia(
        float(mj.body_mass[body]), mj.body_ipos[body], R @ np.diag(mj.body_inertia[body]) @ R.T
    )


def _add_frame(model: pin.Model, name: str, joint: int, M: pin.SE3, kind: pin.FrameType) -> None:
    model.addFrame(pin.Frame(name, joint, 0, M, kind))


def _se3(quat_wxyz: Array, position: Array) -> pin.SE3:
    w, x, y, z = quat_wxyz
    return pin.SE3(pin.Quaternion(w, x, y, z).matrix(), position)


def _name(mj: mujoco.MjModel, kind: str, index: int) -> str:
    return str(getattr(mj, kind)(index).name)


def _difference(a: Array, b: Array) -> float:
    # Equal infinities do not differ.
    return max((abs(x - y) for x, y in zip(a.flat, b.flat, strict=True) if x != y), default=0.0)


def _require(robot: str, what: str, difference: float) -> None:
    if not abs(difference) <= POSE_TOLERANCE:
        raise ModelMismatch(robot, what, abs(difference), POSE_TOLERANCE)
