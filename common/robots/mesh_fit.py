"""Does a model with meshes move as ours does?"""

from __future__ import annotations

import math

import mujoco
import numpy as np

from common.errors import MeshesDoNotFit
from common.robots.spec import BodyMeshSpec, MeshesSpec
from common.se3 import Array, distance, invert, make_pose, pose_from_wire

TOLERANCE_M = 3e-3
TOLERANCE_RAD = 0.02
POSTURES = 4
"""Compared at random: one would be enough, but for a coincidence."""

_SCALAR_JOINTS = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


def check_fit(robot: str, table: MeshesSpec, ours: mujoco.MjModel, theirs: mujoco.MjModel) -> None:
    """Compare where the paired bodies are, seen from the first pair, at equal joint positions.

    The joints of a body correspond to those of the body that it is paired with, in their order. The
    first pair may stand anywhere: what carries it is not compared.

    Args:
        robot: Its name, for the error.
        table: The pairs; the names in it exist.
        ours: The compiled robot, alone.
        theirs: The other compiled model.

    Raises:
        MeshesDoNotFit: A body differs by more than a few millimetres or a degree.
    """
    mine, foreign = mujoco.MjData(ours), mujoco.MjData(theirs)
    for each in table.posture:
        foreign.qpos[theirs.joint(each.joint).qposadr[0]] = each.position
    counterparts = _find_counterparts(table, ours, theirs)
    generator = np.random.default_rng(0)
    for _ in range(POSTURES):
        for joint in range(ours.njnt):
            if int(ours.jnt_type[joint]) in _SCALAR_JOINTS:
                position = generator.uniform(*_range(ours, joint))
                mine.qpos[ours.jnt_qposadr[joint]] = position
                if joint in counterparts:
                    foreign.qpos[theirs.jnt_qposadr[counterparts[joint]]] = position
        mujoco.mj_kinematics(ours, mine)
        mujoco.mj_kinematics(theirs, foreign)
        _compare(robot, table, mine, foreign)


def _compare(robot: str, table: MeshesSpec, mine: mujoco.MjData, foreign: mujoco.MjData) -> None:
    root = table.bodies[0]
    T_root_world = invert(_pose(mine, root.ours))
    T_root_other = invert(_as_ours(foreign, root))
    for pair in table.bodies:
        apart = distance(
            T_root_world @ _pose(mine, pair.ours), T_root_other @ _as_ours(foreign, pair)
        )
        if apart[0] > TOLERANCE_M or apart[1] > TOLERANCE_RAD:
            most = (TOLERANCE_M, TOLERANCE_RAD)
            raise MeshesDoNotFit(robot, pair.ours, apart=apart, most=most)


def _find_counterparts(
    table: MeshesSpec, ours: mujoco.MjModel, theirs: mujoco.MjModel
) -> dict[int, int]:
    """Joint of ours -> joint of theirs, for every paired body but the root."""
    found: dict[int, int] = {}
    seen = {table.bodies[0].ours}
    for pair in table.bodies:
        if pair.ours not in seen:
            # Where one has fewer joints the poses will differ, and say so.
            mine, foreign = _joints(ours, pair.ours), _joints(theirs, pair.theirs)
            found |= dict(zip(mine, foreign, strict=False))
        seen.add(pair.ours)
    return found


def _joints(model: mujoco.MjModel, body: str) -> list[int]:
    first, count = int(model.body(body).jntadr[0]), int(model.body(body).jntnum[0])
    return [j for j in range(first, first + count) if int(model.jnt_type[j]) in _SCALAR_JOINTS]


def _range(model: mujoco.MjModel, joint: int) -> tuple[float, float]:
    if not model.jnt_limited[joint]:
        return -math.pi, math.pi
    lower, upper = model.jnt_range[joint].tolist()
    return lower, upper


def _pose(data: mujoco.MjData, body: str) -> Array:
    found = data.body(body)
    return make_pose(found.xmat.reshape(3, 3), found.xpos)


def _as_ours(foreign: mujoco.MjData, pair: BodyMeshSpec) -> Array:
    """T_world_ours where the other model has it."""
    return _pose(foreign, pair.theirs) @ invert(pose_from_wire(pair.T_ours_theirs))
