"""The Pinocchio model against MuJoCo, on the shipped robots and on a tree with every oddity."""

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from common.errors import BadRobotFile, ModelMismatch
from common.robots import load_robot
from common.robots.compile import compile_robot
from services.retarget.model import build_pinocchio_model, check_agreement
from services.retarget.robot_model import RobotModel

ODD_TREE = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body name="base" pos="0.1 -0.2 0.3" quat="0.9 0.1 -0.2 0.3">
      <geom type="box" size="0.1 0.05 0.02" mass="2"/>
      <body name="carriage" pos="0.1 0 0.2" quat="0.8 0.3 0.2 0.1">
        <joint name="x" type="slide" axis="1 0.2 0" range="-0.5 0.7"/>
        <joint name="yaw" type="hinge" axis="0.1 0.2 1" pos="0.02 0.03 0.04" range="-1 2"
               ref="0.3"/>
        <joint name="roll" type="hinge" axis="1 1 0" pos="-0.01 0 0.05"/>
        <geom type="capsule" fromto="0 0 0 0.1 0.1 0.2" size="0.03" mass="1.3"/>
        <body name="mount" pos="0.1 0.05 0" quat="0.7 0 0.7 0.1">
          <site name="on_mount" pos="0.02 0.01 0.03" quat="0.6 0.4 0.2 0.1"/>
          <body name="arm" pos="0 0 0.3">
            <joint name="pitch" type="hinge" axis="0 1 0.3" ref="-0.2" range="-2 2"/>
            <geom type="sphere" pos="0.05 0 0.1" size="0.05" mass="0.7"/>
            <site name="tip" pos="0.1 0.2 0.3" quat="0.5 0.5 -0.1 0.2"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def _panda():
    return compile_robot(load_robot("panda"))


def _odd():
    return mujoco.MjModel.from_xml_string(ODD_TREE)


@pytest.mark.parametrize(("make", "site"), [(_panda, "tool"), (_odd, "tip"), (_odd, "on_mount")])
def test_sites_jacobians_and_gravity_agree(make, site):
    mj = make()
    mj.body_gravcomp[:] = 0.0
    model = build_pinocchio_model(mj, robot="test")
    data, mj_data = model.createData(), mujoco.MjData(mj)
    frame = model.getFrameId(site, pin.FrameType.OP_FRAME)
    random = np.random.default_rng(1)
    for _ in range(20):
        q = random.uniform(-1.5, 1.5, mj.nq)
        mj_data.qpos[:] = q + mj.qpos0
        mujoco.mj_forward(mj, mj_data)
        J = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)
        pose = pin.updateFramePlacement(model, data, frame)
        linear, angular = np.zeros((3, mj.nv)), np.zeros((3, mj.nv))
        mujoco.mj_jacSite(mj, mj_data, linear, angular, mj.site(site).id)
        assert pose.translation == pytest.approx(mj_data.site(site).xpos, abs=1e-12)
        assert pose.rotation.ravel() == pytest.approx(mj_data.site(site).xmat, abs=1e-12)
        assert np.abs(J - np.vstack([linear, angular])).max() < 1e-12
        gravity = pin.computeGeneralizedGravity(model, data, q)
        assert gravity == pytest.approx(mj_data.qfrc_bias, abs=1e-10)


def test_mass_matrix_agrees():
    mj = _panda()
    model = build_pinocchio_model(mj, robot="panda")
    data, mj_data = model.createData(), mujoco.MjData(mj)
    q = np.array(load_robot("panda").start_positions)
    mj_data.qpos[:] = q
    mujoco.mj_forward(mj, mj_data)
    M = np.zeros((mj.nv, mj.nv))
    mujoco.mj_fullM(mj, mj_data, M)
    ours = pin.crba(model, data, q)
    ours = np.triu(ours) + np.triu(ours, 1).T
    assert np.abs(ours - M).max() < 1e-10


def test_ranges_are_moved_by_the_reference_position():
    model = build_pinocchio_model(_odd(), robot="odd")
    assert model.lowerPositionLimit == pytest.approx([-0.5, -1.3, -np.inf, -1.8])
    assert model.upperPositionLimit == pytest.approx([0.7, 1.7, np.inf, 2.2])


@pytest.mark.parametrize(
    ("what", "spoil"),
    [
        ("position of link3", lambda mj: mj.body_pos.__setitem__((4, 1), 1e-6)),
        ("lower joint limit", lambda mj: mj.jnt_range.__setitem__((2, 0), -1.0)),
        ("total mass", lambda mj: mj.body_mass.__setitem__(3, 9.0)),
    ],
)
def test_the_guard_names_what_differs(what, spoil):
    mj = _panda()
    model = build_pinocchio_model(mj, robot="panda")
    spoil(mj)
    with pytest.raises(ModelMismatch, match=what):
        check_agreement(model, mj, robot="panda")


def test_the_guard_counts_joints():
    with pytest.raises(ModelMismatch, match="number of joint positions"):
        check_agreement(build_pinocchio_model(_odd(), robot="x"), _panda(), robot="x")


def test_ball_joints_are_refused():
    with pytest.raises(BadRobotFile, match="hand_turn"):
        build_pinocchio_model(compile_robot(load_robot("abstract")), robot="abstract")


def test_model_of_a_robot_knows_tool_and_ranges():
    spec = load_robot("panda")
    model = RobotModel(spec)
    q = np.array(spec.start_positions)
    T, J = model.compute_hand(q)
    assert T[:3, 3] == pytest.approx([0.1, -0.3, 0.8], abs=1e-6)
    assert np.array_equal(T, model.compute_tool_pose(q))
    assert J.shape == (6, 7)
    assert model.lower == pytest.approx(
        [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]
    )
