"""Compile a robot's MJCF and check it against its robot.toml. Needs MuJoCo (the extra [sim])."""

from __future__ import annotations

import mujoco

from common.errors import BadRobotFile
from common.robots.spec import JointSpec, RobotSpec
from common.se3 import Array, distance, make_pose, pose_from_wire

START_TOLERANCE_M = 1e-4
START_TOLERANCE_RAD = 1e-3

_SCALAR_JOINTS = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


def compile_robot(spec: RobotSpec) -> mujoco.MjModel:
    """Compile model.xml, the robot alone, and check that it and robot.toml agree.

    Checked: angles in radians; no actuators; the joints of both files are the same in the same
    order; start and bias within the joint ranges; the tool site exists and stands at
    `T_world_start` when the joints are at their start.

    Raises:
        BadRobotFile: Something does not hold; names the joint or element.
    """
    mj = _compile(spec)
    if mj.nu:
        raise BadRobotFile(spec.name, "actuator", "servos come from robot.toml, not from the MJCF")
    if spec.kind == "joints":
        _check_joints(spec, mj)
    if mj.nq != spec.nq:
        raise BadRobotFile(spec.name, "model.xml", f"has {mj.nq} positions, expected {spec.nq}")
    _check_start(spec, mj)
    return mj


def compute_tool_pose(spec: RobotSpec, mj: mujoco.MjModel, positions: list[float]) -> Array:
    """Pose (4, 4) of the tool in the world, by MuJoCo's forward kinematics.

    Args:
        spec: The robot.
        mj: Its compiled model, alone.
        positions: As in `RobotState.positions`.
    """
    data = mujoco.MjData(mj)
    data.qpos[:] = positions
    mujoco.mj_kinematics(mj, data)
    site = data.site(spec.tool_site)
    return make_pose(site.xmat.reshape(3, 3), site.xpos)


def _compile(spec: RobotSpec) -> mujoco.MjModel:
    try:
        mjcf = mujoco.MjSpec.from_file(str(spec.model_path))
        degrees = bool(mjcf.compiler.degree)
        mj = mjcf.compile()
    except ValueError as error:
        raise BadRobotFile(spec.name, "model.xml", str(error)) from error
    # MJCF's default is degrees, and a range in the wrong unit stays unnoticed for long.
    if degrees:
        raise BadRobotFile(spec.name, "compiler", 'angle="radian" is required')
    return mj


def _check_joints(spec: RobotSpec, mj: mujoco.MjModel) -> None:
    in_model = [str(mj.joint(j).name) for j in range(mj.njnt)]
    in_file = [joint.name for joint in spec.joints]
    for index, name in enumerate(in_file):
        if index >= len(in_model):
            raise BadRobotFile(spec.name, f"joint {name}", "is missing in model.xml")
        if in_model[index] != name:
            found = in_model[index]
            raise BadRobotFile(spec.name, f"joint {name}", f"model.xml has {found} in its place")
    if len(in_model) > len(in_file):
        extra = in_model[len(in_file)]
        raise BadRobotFile(spec.name, f"joint {extra}", "is missing in robot.toml")
    for index, joint in enumerate(spec.joints):
        _check_joint(spec.name, mj, index, joint)


def _check_joint(robot: str, mj: mujoco.MjModel, index: int, joint: JointSpec) -> None:
    if int(mj.jnt_type[index]) not in _SCALAR_JOINTS:
        raise BadRobotFile(robot, f"joint {joint.name}", "is neither hinge nor slide")
    if not mj.jnt_limited[index]:
        return
    lower, upper = (float(value) for value in mj.jnt_range[index])
    for what, value in (("start", joint.start), ("bias", joint.bias)):
        if not lower <= value <= upper:
            problem = f"{what} {value:g} is outside the range {lower:g} to {upper:g}"
            raise BadRobotFile(robot, f"joint {joint.name}", problem)


def _check_start(spec: RobotSpec, mj: mujoco.MjModel) -> None:
    if mujoco.mj_name2id(mj, mujoco.mjtObj.mjOBJ_SITE, spec.tool_site) < 0:
        raise BadRobotFile(spec.name, f"site {spec.tool_site}", "is missing in model.xml")
    T_world_tool = compute_tool_pose(spec, mj, spec.start_positions)
    error_m, error_rad = distance(pose_from_wire(spec.T_world_start), T_world_tool)
    if error_m > START_TOLERANCE_M or error_rad > START_TOLERANCE_RAD:
        problem = f"the tool is {error_m:.2g} m and {error_rad:.2g} rad away from T_world_start"
        raise BadRobotFile(spec.name, "start", problem)
