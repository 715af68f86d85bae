"""The analytic leg: its closed form against MuJoCo, and what it says when a foot cannot stay."""

import itertools
import re

import mujoco
import numpy as np
import pytest

from common.errors import BadRobotFile, FootholdOutOfReach
from common.robots import load_robot
from common.robots.compile import compile_robot, find_positions
from common.robots.leg import Leg, read_legs

SPOT = load_robot("spot")
BODY = find_positions(SPOT, compile_robot(SPOT))[:6]


@pytest.fixture
def mj() -> mujoco.MjModel:
    return compile_robot(SPOT)


class Stand:
    """A body on its legs: MuJoCo's forward kinematics of what `Leg.solve` says."""

    def __init__(self, mj: mujoco.MjModel) -> None:
        self.mj, self.data = mj, mujoco.MjData(mj)
        self.legs = read_legs(mj, SPOT)
        self.joints = [int(mj.joint(name).qposadr[0]) for name in SPOT.leg_joints]
        self.lower, self.upper = mj.jnt_range[[mj.joint(n).id for n in SPOT.leg_joints]].T
        self.feet = [mj.site(leg.foot_site).id for leg in SPOT.legs]
        self.base = mj.body("base").id

    def find_foot_error_m(self, body: list[float]) -> float:
        """Put the body at x, y, z, yaw, pitch, roll and the legs under it."""
        data = self.data
        data.qpos[BODY] = body
        mujoco.mj_kinematics(self.mj, data)
        p, R = data.xpos[self.base], data.xmat[self.base].reshape(3, 3)
        angles = np.array([angle for leg in self.legs for angle in leg.solve(p, R)])
        assert (angles >= self.lower).all()
        assert (angles <= self.upper).all()
        data.qpos[self.joints] = angles
        mujoco.mj_kinematics(self.mj, data)
        footholds = [leg.foothold for leg in SPOT.legs]
        return float(np.linalg.norm(data.site_xpos[self.feet] - footholds, axis=1).max())


def test_feet_stay_in_every_corner_of_the_body_box(mj):
    stand = Stand(mj)
    corners = itertools.product(*(mj.joint(joint.name).range for joint in SPOT.joints[:6]))
    errors = [stand.find_foot_error_m(list(corner)) for corner in corners]
    assert len(errors) == 64
    assert max(errors) < 1e-9


def test_feet_stay_at_random_poses_of_the_body(mj):
    stand = Stand(mj)
    lower, upper = np.array([mj.joint(joint.name).range for joint in SPOT.joints[:6]]).T
    poses = np.random.default_rng(0).uniform(lower, upper, (2000, 6))
    assert max(stand.find_foot_error_m(pose.tolist()) for pose in poses) < 1e-9


def test_the_closed_form_inverts_the_forward_map_for_any_bent_leg(mj):
    leg = read_legs(mj, SPOT)[0]
    data = mujoco.MjData(mj)
    addresses = [int(mj.joint(joint).qposadr[0]) for joint in leg.joints]
    random = np.random.default_rng(1)
    for _ in range(300):
        q = random.uniform([-0.6, -0.5, -2.6], [0.6, 1.8, -0.3])
        data.qpos[addresses] = q
        mujoco.mj_kinematics(mj, data)
        p_world_foot = data.site("foot_fl").xpos.copy()
        if p_world_foot @ [0.0, np.sin(q[0]), -np.cos(q[0])] < 0.03:
            continue
        moved = Leg(**{**vars(leg), "p_world_foot": p_world_foot})
        assert moved.solve(np.zeros(3), np.eye(3)) == pytest.approx(tuple(q), abs=1e-9)


@pytest.mark.parametrize(
    ("p_world_body", "problem"),
    [
        ([-0.2, 0.0, 0.75], "where the leg spans"),
        ([-0.2, 0.05, 0.05], "beside the hip"),
        ([-0.2, 0.3, 0.35], "fl_hx would be at"),
        ([-0.2, 0.0, 0.7], "fl_kn would be at"),
    ],
)
def test_a_foothold_out_of_reach_is_named(mj, p_world_body, problem):
    leg = read_legs(mj, SPOT)[0]
    with pytest.raises(FootholdOutOfReach, match=problem) as caught:
        leg.solve(np.array(p_world_body), np.eye(3))
    assert caught.value.leg == "fl"
    assert caught.value.code == "E-FOOTHOLD"


@pytest.mark.parametrize(
    ("pattern", "replacement", "problem"),
    [
        ('name="fl_hy"', 'name="fl_hy" axis="0 0 1"', "hip pitch does not turn"),
        ('name="fl_kn"', 'name="fl_kn" pos="0 0 0.01"', "knee is not at"),
        ('name="fl_kn" range="[^"]*"', 'name="fl_kn"', "knee has no range"),
        ('name="fl_thigh" pos="0 ', 'name="fl_thigh" pos="0.1 ', "offset along y alone"),
        ('name="fl_shank" pos="0.025 0 ', 'name="fl_shank" pos="0.025 0.1 ', "leaves the plane"),
        ('name="fl_shank" pos', 'name="fl_shank" euler="0 0.1 0" pos', "turned in its parent"),
        ('name="foot_fl"', 'name="other"/><site name="foot_fr"', "do not follow each other"),
    ],
)
def test_a_leg_of_another_build_is_refused(pattern, replacement, problem):
    text, count = re.subn(pattern, replacement, SPOT.model_path.read_text(), count=1)
    assert count == 1
    if "foot_fr" in replacement:
        text = text.replace('<site name="foot_fr"', '<site name="foot_fl"')
        text = text.replace('<site name="foot_fl"', '<site name="foot_fr"', 1)
    mj = mujoco.MjModel.from_xml_string(text)
    with pytest.raises(BadRobotFile, match=problem) as caught:
        read_legs(mj, SPOT)
    assert caught.value.element == "leg fl"
