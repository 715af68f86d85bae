"""Compile a robot's MJCF and check it against its robot.toml. Needs MuJoCo (the extra [sim])."""

from __future__ import annotations

import math
from collections.abc import Iterator
from xml.etree import ElementTree

import mujoco

from common.errors import BadRobotFile
from common.robots.spec import JointSpec, RobotSpec
from common.se3 import Array, distance, make_pose, pose_from_wire

START_TOLERANCE_M = 1e-4
START_TOLERANCE_RAD = 1e-3

_SCALAR_JOINTS = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


def compile_robot(spec: RobotSpec) -> mujoco.MjModel:
    """Compile model.xml, the robot alone, and check that it and robot.toml agree.

    Checked: every number finite; angles in radians; no actuators; every body and joint has a name;
    the joints of both files are the same in the same order, joints of legs set aside; no range
    empty; start and bias within the joint ranges; every site and geom that robot.toml names exists;
    the tool stands at `T_world_start` when the joints are at their start.

    Raises:
        BadRobotFile: Something does not hold; names the joint or element.
    """
    mj = _compile(spec)
    if mj.nu:
        raise BadRobotFile(spec.name, "actuator", "servos come from robot.toml, not from the MJCF")
    _check_named(spec, mj)
    if spec.kind == "joints":
        _check_joints(spec, mj)
    expected = spec.nq + len(spec.leg_joints)
    if mj.nq != expected:
        raise BadRobotFile(spec.name, "model.xml", f"has {mj.nq} positions, expected {expected}")
    _check_names(spec, mj)
    _check_start(spec, mj)
    return mj


def find_positions(spec: RobotSpec, mj: mujoco.MjModel) -> list[int]:
    """Where each entry of `RobotState.positions` is in the qpos of the compiled robot."""
    if spec.kind == "free_hand":
        return list(range(spec.nq))
    return [int(mj.joint(joint.name).qposadr[0]) for joint in spec.joints]


def read_ranges(
    spec: RobotSpec, mj: mujoco.MjModel, *, prefix: str = ""
) -> list[tuple[float, float]]:
    """Lower and upper end of every joint's range [rad, m], infinite where it has none.

    Args:
        spec: The robot.
        mj: A compiled model with it.
        prefix: Of the robot's names in the model.
    """
    joints = [mj.joint(prefix + joint.name) for joint in spec.joints]
    return [
        (float(joint.range[0]), float(joint.range[1]))
        if mj.jnt_limited[joint.id]
        else (-math.inf, math.inf)
        for joint in joints
    ]


def compute_tool_pose(spec: RobotSpec, mj: mujoco.MjModel, positions: list[float]) -> Array:
    """Pose (4, 4) of the tool in the world, by MuJoCo's forward kinematics.

    Args:
        spec: The robot.
        mj: Its compiled model, alone.
        positions: As in `RobotState.positions`.
    """
    data = mujoco.MjData(mj)
    data.qpos[find_positions(spec, mj)] = positions
    mujoco.mj_kinematics(mj, data)
    site = data.site(spec.tool_site)
    return make_pose(site.xmat.reshape(3, 3), site.xpos)


def _compile(spec: RobotSpec) -> mujoco.MjModel:
    _check_numbers(spec)
    try:
        mjcf = mujoco.MjSpec.from_file(str(spec.model_path))
        degrees = bool(mjcf.compiler.degree)
        mj = mjcf.compile()
    except ValueError as error:
        # MuJoCo spreads its message over lines; the second one names the element.
        problem = ", ".join(str(error).removeprefix("Error: ").splitlines())
        raise BadRobotFile(spec.name, "model.xml", problem) from error
    # MJCF's default is degrees, and a range in the wrong unit stays unnoticed for long.
    if degrees:
        raise BadRobotFile(spec.name, "compiler", 'angle="radian" is required')
    return mj


def _check_numbers(spec: RobotSpec) -> None:
    """Refuse NaN and infinity, which MuJoCo compiles after a warning of its own."""
    try:
        root = ElementTree.parse(spec.model_path).getroot()
    except ElementTree.ParseError:
        # MuJoCo says better what is wrong.
        return
    for element, owner in _walk(root, "model.xml"):
        for attribute, text in element.attrib.items():
            if any(word.lower().lstrip("+-") in ("nan", "inf") for word in text.split()):
                raise BadRobotFile(spec.name, owner, f"{element.tag} {attribute} is {text!r}")


def _walk(element: ElementTree.Element, owner: str) -> Iterator[tuple[ElementTree.Element, str]]:
    """An element and all below it, each with the nearest named one that it is, or is in."""
    name = element.get("name") or element.get("class")
    if name:
        owner = f"{element.tag} {name}"
    yield element, owner
    for child in element:
        yield from _walk(child, owner)


def _check_named(spec: RobotSpec, mj: mujoco.MjModel) -> None:
    """Bodies become frames that are looked up by name, and errors name them."""
    for body in range(1, mj.nbody):
        if not mj.body(body).name:
            parent = mj.body(int(mj.body_parentid[body])).name
            raise BadRobotFile(spec.name, f"body in {parent}", "has no name")
    for joint in range(mj.njnt):
        if not mj.joint(joint).name:
            body = mj.body(int(mj.jnt_bodyid[joint])).name
            raise BadRobotFile(spec.name, f"joint of body {body}", "has no name")


def _check_joints(spec: RobotSpec, mj: mujoco.MjModel) -> None:
    names = [str(mj.joint(j).name) for j in range(mj.njnt)]
    for leg_joint in spec.leg_joints:
        if leg_joint not in names:
            raise BadRobotFile(spec.name, f"joint {leg_joint}", "is missing in model.xml")
    in_model = [name for name in names if name not in spec.leg_joints]
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
    for joint in spec.joints:
        _check_joint(spec.name, mj, joint)


def _check_joint(robot: str, mj: mujoco.MjModel, joint: JointSpec) -> None:
    index = int(mj.joint(joint.name).id)
    if int(mj.jnt_type[index]) not in _SCALAR_JOINTS:
        raise BadRobotFile(robot, f"joint {joint.name}", "is neither hinge nor slide")
    lower, upper = (float(value) for value in mj.jnt_range[index])
    if not mj.jnt_limited[index]:
        # MuJoCo takes an empty range for none.
        if lower or upper:
            problem = f"the range {lower:g} to {upper:g} is empty"
            raise BadRobotFile(robot, f"joint {joint.name}", problem)
        return
    for what, value in (("start", joint.start), ("bias", joint.bias)):
        if not lower <= value <= upper:
            problem = f"{what} {value:g} is outside the range {lower:g} to {upper:g}"
            raise BadRobotFile(robot, f"joint {joint.name}", problem)


def _check_names(spec: RobotSpec, mj: mujoco.MjModel) -> None:
    sites = [spec.tool_site, *(leg.foot_site for leg in spec.legs)]
    sites += [wall.site for wall in spec.walls]
    sites += [spec.head.site] if spec.head else []
    geoms = [name for pair in spec.collision.pairs for name in pair]
    geoms += spec.collision.obstacle_geoms
    wanted = [("site", mujoco.mjtObj.mjOBJ_SITE, name) for name in sites]
    wanted += [("geom", mujoco.mjtObj.mjOBJ_GEOM, name) for name in geoms]
    for kind, mj_kind, name in wanted:
        if mujoco.mj_name2id(mj, mj_kind, name) < 0:
            raise BadRobotFile(spec.name, f"{kind} {name}", "is missing in model.xml")


def _check_start(spec: RobotSpec, mj: mujoco.MjModel) -> None:
    T_world_tool = compute_tool_pose(spec, mj, spec.start_positions)
    error_m, error_rad = distance(pose_from_wire(spec.T_world_start), T_world_tool)
    if error_m > START_TOLERANCE_M or error_rad > START_TOLERANCE_RAD:
        problem = f"the tool is {error_m:.2g} m and {error_rad:.2g} rad away from T_world_start"
        raise BadRobotFile(spec.name, "start", problem)
