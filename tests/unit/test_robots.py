"""Robot folders: what must agree, and what is said when it does not."""

import re
import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest

from common.errors import BadRobotFile, UnknownName
from common.robots import list_robots, load_robot
from common.robots.compile import compile_robot, compute_tool_pose
from common.robots.loader import ROBOTS_FOLDER
from common.se3 import distance, invert, make_pose, pose_from_wire


@pytest.mark.parametrize("name", list_robots())
def test_every_robot_starts_with_the_tool_at_the_common_pose(name):
    spec = load_robot(name)
    T_world_tool = compute_tool_pose(spec, compile_robot(spec), spec.start_positions)
    error_m, error_rad = distance(pose_from_wire([0.1, -0.3, 0.8, 1, 0, 0, 0]), T_world_tool)
    assert error_m < 1e-6
    assert error_rad < 1e-6


def test_unknown_robot_is_named_with_a_suggestion():
    with pytest.raises(UnknownName) as caught:
        load_robot("pnda")
    assert caught.value.suggestion == "panda"


def test_panda_is_the_published_arm():
    spec = load_robot("panda")
    mj = compile_robot(spec)
    assert mj.body_mass.sum() == pytest.approx(16.6919, abs=1e-4)
    assert [joint.torque_limit for joint in spec.joints] == [87.0] * 4 + [12.0] * 3
    assert (mj.body_gravcomp[1:] == 1.0).all()
    # LEGATO's neutral posture and tool point; its rounded flange differs by half a millimetre.
    neutral = [-np.pi / 8, np.pi / 5, -np.pi / 8, -0.7 * np.pi, 0.75 * np.pi, np.pi / 2]
    T_world_tool = compute_tool_pose(spec, mj, [*neutral, -0.666 * np.pi])
    assert T_world_tool[:3, 3] == pytest.approx([0.27123, -0.3346, 0.85035], abs=6e-4)


def test_panda_start_has_margins():
    spec = load_robot("panda")
    mj = compile_robot(spec)
    q = np.array(spec.start_positions)
    assert np.minimum(q - mj.jnt_range[:, 0], mj.jnt_range[:, 1] - q).min() > 0.25


def test_panda_arm_meets_the_scene_but_not_itself():
    mj = compile_robot(load_robot("panda"))
    arm = mj.geom_bodyid > 0
    assert (mj.geom_contype[arm] & 1 == 0).all()
    assert (mj.geom_conaffinity[arm] == 1).all()
    assert (mj.geom_contype[arm] & mj.geom_conaffinity[arm] == 0).all()


def test_panda_last_link_is_behind_the_cameras():
    spec = load_robot("panda")
    mj = compile_robot(spec)
    data = mujoco.MjData(mj)
    mujoco.mj_kinematics(mj, data)
    tool = data.site(spec.tool_site)
    T_tool_world = invert(make_pose(tool.xmat.reshape(3, 3), tool.xpos))
    eyes_x_m = 0.06
    last_link = mj.body("link7").id
    for geom in np.flatnonzero(mj.geom_bodyid == last_link):
        centre = T_tool_world @ [*data.geom_xpos[geom], 1.0]
        assert centre[0] + mj.geom_rbound[geom] < eyes_x_m


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    shutil.copytree(ROBOTS_FOLDER / "panda", tmp_path / "panda")
    return tmp_path


def _edit(path: Path, pattern: str, replacement: str) -> None:
    text, count = re.subn(pattern, replacement, path.read_text(), count=1)
    assert count == 1
    path.write_text(text)


@pytest.mark.parametrize(
    ("file", "pattern", "replacement", "element", "problem"),
    [
        ("model.xml", 'angle="radian"', 'angle="degree"', "compiler", "radian"),
        ("model.xml", '"joint3"', '"elbow"', "joint joint3", "elbow in its place"),
        ("robot.toml", '"joint7"', '"wrist"', "joint wrist", "joint7 in its place"),
        (
            "robot.toml",
            r"\[\[joints\]\]\nname = \"joint7\"(.|\n)*",
            "",
            "joint joint7",
            "robot.toml",
        ),
        ("model.xml", r'<joint name="joint7"[^/]*/>', "", "joint joint7", "missing in model.xml"),
        ("model.xml", 'range="-3.0718 -0.0698"', 'range="-2 -0.0698"', "joint joint4", "start"),
        ("robot.toml", r"bias = -2.6\d*", "bias = 1.0", "joint joint4", "bias"),
        ("robot.toml", r"start = 0.0\d*", "start = -0.6", "start", "away from T_world_start"),
        ("model.xml", 'site name="tool"', 'site name="hook"', "site tool", "missing"),
        ("model.xml", "</worldbody>", "</worldbody><oops/>", "model.xml", "oops"),
        (
            "model.xml",
            "</mujoco>",
            '<actuator><motor joint="joint1"/></actuator></mujoco>',
            "actuator",
            "robot.toml",
        ),
        (
            "model.xml",
            'name="joint1" range="-2.8973 2.8973"',
            'name="joint1" type="ball" range="0 1"',
            "joint joint1",
            "neither hinge nor slide",
        ),
    ],
)
def test_contradictions_are_named(folder, file, pattern, replacement, element, problem):
    _edit(folder / "panda" / file, pattern, replacement)
    with pytest.raises(BadRobotFile) as caught:
        compile_robot(load_robot("panda", folder=folder))
    assert caught.value.element == element
    assert problem in caught.value.problem


def test_unknown_entry_in_robot_toml_is_refused(folder):
    _edit(folder / "panda" / "robot.toml", "kp = ", "gain = ")
    with pytest.raises(BadRobotFile) as caught:
        load_robot("panda", folder=folder)
    assert caught.value.element.startswith("joints.0")


def test_missing_model_is_named(folder):
    (folder / "panda" / "model.xml").unlink()
    with pytest.raises(BadRobotFile, match="the file is missing"):
        load_robot("panda", folder=folder)
