"""The GR-1: the published figures, a start with room to move, and a body that holds still."""

import mujoco
import numpy as np
import pytest

from common.clock import TICK_S
from common.robots import load_robot
from common.robots.compile import compile_robot, compute_tool_pose
from common.se3 import distance, exp3, log3, make_pose, pose_from_wire
from common.tasks import load_task
from services.retarget.reference import TickReference
from services.retarget.robot_model import RobotModel
from services.retarget.whole_body import WholeBodyRetargeter
from services.sim.world import World

PUBLISHED_KG = 55.0
HAND_TAKEN_OFF_KG = 0.4
# The manufacturer's description; pelvis and right hand are changed on purpose and stand apart.
MASSES_KG = {
    "waist_yaw": 0.37886,
    "waist_pitch": 4.40328,
    "waist_roll": 7.34393,
    "head_yaw": 0.168425,
    "head_roll": 0.0189574,
    "head_pitch": 0.315067,
    "l_upper_arm_pitch": 0.777394,
    "l_upper_arm_roll": 0.084111,
    "l_upper_arm_yaw": 0.78993,
    "l_lower_arm_pitch": 0.0553958,
    "l_hand_yaw": 0.606076,
    "l_hand_roll": 0.0054473,
    "l_hand_pitch": 0.5239,
    "r_upper_arm_pitch": 0.777391,
    "r_upper_arm_roll": 0.0840989,
    "r_upper_arm_yaw": 0.78993,
    "r_lower_arm_pitch": 0.0553958,
    "r_hand_yaw": 0.606076,
    "r_hand_roll": 0.0054473,
    "l_thigh_roll": 1.1437,
    "l_thigh_yaw": 3.9888,
    "l_thigh_pitch": 6.369,
    "l_shank_pitch": 2.1895,
    "l_foot_pitch": 0.080335,
    "l_foot_roll": 0.584,
    "r_thigh_roll": 1.14367,
    "r_thigh_yaw": 3.98882,
    "r_thigh_pitch": 6.36895,
    "r_shank_pitch": 2.18947,
    "r_foot_pitch": 0.0799219,
    "r_foot_roll": 0.58089,
}
# Range [rad] and torque limit [N m], in the order of the joints.
LIMITS = {
    "waist_yaw": (-1.05, 1.05, 82.5),
    "waist_pitch": (-0.52, 1.22, 82.5),
    "waist_roll": (-0.7, 0.7, 82.5),
    "head_yaw": (-2.71, 2.71, 10.2),
    "head_roll": (-0.35, 0.35, 3.95),
    "head_pitch": (-0.52, 0.35, 3.95),
    "l_shoulder_pitch": (-2.79, 1.92, 38.0),
    "l_shoulder_roll": (-0.57, 3.27, 38.0),
    "l_shoulder_yaw": (-2.97, 2.97, 30.0),
    "l_elbow_pitch": (-2.27, 2.27, 30.0),
    "l_wrist_yaw": (-2.97, 2.97, 10.2),
    "l_wrist_roll": (-0.61, 0.61, 3.95),
    "l_wrist_pitch": (-0.61, 0.61, 3.95),
    "r_shoulder_pitch": (-2.79, 1.92, 38.0),
    "r_shoulder_roll": (-3.27, 0.57, 38.0),
    "r_shoulder_yaw": (-2.97, 2.97, 30.0),
    "r_elbow_pitch": (-2.27, 2.27, 30.0),
    "r_wrist_yaw": (-2.97, 2.97, 10.2),
    "r_wrist_roll": (-0.61, 0.61, 3.95),
    "r_wrist_pitch": (-0.61, 0.61, 3.95),
}
AXIS_OF_WORD = {"roll": (1, 0, 0), "pitch": (0, 1, 0), "yaw": (0, 0, 1)}
NEUTRAL = {
    "l_shoulder_roll": 0.5026548,
    "l_shoulder_yaw": -1.036726,
    "l_elbow_pitch": -0.5026548,
    "l_wrist_pitch": -0.5026548,
    "r_shoulder_roll": -0.5026548,
    "r_shoulder_yaw": 1.036726,
    "r_elbow_pitch": -0.5026548,
    "r_wrist_pitch": -0.5026548,
}
EYES = [(0.06, 0.032, 0.0525), (0.06, -0.032, 0.0525)]
EDGE_OF_VIEW_RAD = np.deg2rad(81.5)
PITCHED = exp3([0.0, np.deg2rad(40.0), 0.0])
# Hover, grasp, lift, above a near and a far seat, the hand 40 degrees down: the lid task's way.
WAY = [(0.37, -0.25, 1.02), (0.41, -0.25, 0.94), (0.39, -0.33, 1.1), (0.46, -0.05, 1.1)]
WAY += [(0.46, -0.05, 1.04), (0.48, 0.05, 1.1), (0.48, 0.05, 1.04)]


@pytest.fixture(scope="module")
def spec():
    return load_robot("gr1")


@pytest.fixture(scope="module")
def mj(spec):
    return compile_robot(spec)


@pytest.fixture(scope="module")
def model(spec):
    return RobotModel(spec)


def _pose(mj, positions):
    data = mujoco.MjData(mj)
    data.qpos[:] = positions
    mujoco.mj_kinematics(mj, data)
    return data


def _neutral(spec):
    return [NEUTRAL.get(joint.name, 0.0) for joint in spec.joints]


def _follow_the_way(retargeter, T_from):
    """Wanted pose and commanded positions of all ticks from a pose along WAY, gently."""
    for p in WAY:
        to = make_pose(PITCHED, p)
        move, turn = to[:3, 3] - T_from[:3, 3], log3(to[:3, :3] @ T_from[:3, :3].T)
        T, before = T_from, 0.0
        for tau in np.arange(1, 151) / 150:
            share = tau**3 * (10.0 - 15.0 * tau + 6.0 * tau**2)
            T_end = make_pose(exp3(share * turn) @ T_from[:3, :3], T_from[:3, 3] + share * move)
            twist = (share - before) / TICK_S * np.concatenate([move, turn])
            yield T_end, np.array(retargeter.follow(TickReference(T, T_end, twist)).positions)
            T, before = T_end, share
        T_from = to


def _look(world, p_tool_eye, directions):
    """Names of all geoms that rays from an eye meet; the camera's own case is group 2."""
    T = world.T_world_tool
    origin = T[:3, :3] @ p_tool_eye + T[:3, 3]
    rays = np.ascontiguousarray(directions @ T[:3, :3].T).ravel()
    count = len(directions)
    hits, distances = np.full(count, -1, np.int32), np.zeros(count)
    groups = np.array([1, 1, 0, 1, 1, 1], np.uint8)
    mujoco.mj_multiRay(
        world.model, world.data, origin, rays, groups, 1, -1, hits, distances, None, count, 10.0
    )
    return {world.model.geom(int(geom)).name for geom in hits if geom >= 0}


def test_masses_are_the_published_ones(mj):
    for body, mass in MASSES_KG.items():
        assert mj.body(body).mass[0] == pytest.approx(mass, rel=1e-9)
    assert set(MASSES_KG) | {"world", "base", "r_hand_pitch"} == {
        mj.body(body).name for body in range(mj.nbody)
    }
    assert mj.body_mass.sum() + HAND_TAKEN_OFF_KG == pytest.approx(PUBLISHED_KG, abs=1e-4)
    assert (mj.body_gravcomp[1:] == 1.0).all()


def test_sums_are_those_of_the_description(mj):
    def total(prefix):
        names = [mj.body(body).name for body in range(mj.nbody)]
        return sum(mj.body(name).mass[0] for name in names if name.startswith(prefix))

    assert total("waist") == pytest.approx(12.1261, abs=1e-4)
    assert total("head") == pytest.approx(0.5024, abs=1e-4)
    assert total(("l_upper", "l_lower", "l_hand")) == pytest.approx(2.8423, abs=1e-4)
    legs = tuple(f"{side}_{part}" for side in "lr" for part in ("thigh", "shank", "foot"))
    assert total(legs) == pytest.approx(28.7071, abs=1e-4)
    right_arm = total(("r_upper", "r_lower", "r_hand"))
    assert right_arm + HAND_TAKEN_OFF_KG == pytest.approx(2.8505, abs=1e-4)


def test_joints_have_the_published_ranges_and_torques(spec, mj):
    assert [joint.name for joint in spec.joints] == list(LIMITS)
    for joint, (lower, upper, torque) in zip(spec.joints, LIMITS.values(), strict=True):
        in_model = mj.joint(joint.name)
        assert in_model.range == pytest.approx((lower, upper))
        assert joint.torque_limit == torque
        assert tuple(in_model.axis) == AXIS_OF_WORD[joint.name.rsplit("_", 1)[1]]


def test_neutral_posture_is_where_the_description_puts_it(spec, mj):
    data = _pose(mj, _neutral(spec))
    # Exact axes move the hands by less than 0.12 mm.
    assert data.site("tool").xpos == pytest.approx([-0.040697, -0.35515, 0.84154], abs=1.2e-4)
    left = data.body("l_hand_pitch").xpos
    assert left == pytest.approx([-0.040598, 0.35514, 0.84152], abs=1.2e-4)


def test_head_looks_ahead_and_fingers_continue_the_forearm_at_zero(mj):
    data = _pose(mj, np.zeros(mj.nq))
    assert data.site("head").xmat.reshape(3, 3) == pytest.approx(np.eye(3), abs=1e-12)
    R_world_tool = data.site("tool").xmat.reshape(3, 3)
    assert R_world_tool[:, 0] == pytest.approx([0, 0, -1], abs=1e-3)
    assert R_world_tool[:, 2] == pytest.approx([0, -1, 0], abs=1e-3)


def test_soles_are_flat_on_the_floor(spec, mj):
    data = _pose(mj, spec.start_positions)
    for side in "lr":
        foot = mj.geom(f"{side}_foot").id
        assert data.geom_xmat[foot].reshape(3, 3)[2] == pytest.approx([0, 0, 1], abs=1e-9)
        assert data.geom_xpos[foot, 2] - mj.geom_size[foot, 2] == pytest.approx(0.0, abs=1e-6)


def test_geoms_meet_the_scene_but_not_each_other(mj):
    assert (mj.geom_contype & 1 == 0).all()
    assert (mj.geom_conaffinity == 1).all()
    assert (mj.geom_contype & mj.geom_conaffinity == 0).all()


def test_start_is_exact_and_has_room(spec, mj):
    q = np.array(spec.start_positions)
    T_world_tool = compute_tool_pose(spec, mj, spec.start_positions)
    error_m, error_rad = distance(pose_from_wire(spec.T_world_start), T_world_tool)
    assert max(error_m, error_rad) < 1e-9
    room = np.minimum(q - mj.jnt_range[:, 0], mj.jnt_range[:, 1] - q)
    moving = [i for i, joint in enumerate(spec.joints) if joint.name.startswith(("waist", "r_"))]
    assert room[moving].min() > 0.15
    assert room.min() > 0.03
    data = _pose(mj, q)
    J = np.zeros((6, mj.nv))
    mujoco.mj_comPos(mj, data)
    mujoco.mj_jacSite(mj, data, J[:3], J[3:], mj.site("tool").id)
    assert np.linalg.svd(J[:, moving], compute_uv=False).min() > 0.2


def test_collision_pairs_begin_apart(spec, mj):
    data = _pose(mj, spec.start_positions)
    for one, other in spec.collision.pairs:
        gap_m = mujoco.mj_geomDistance(mj, data, mj.geom(one).id, mj.geom(other).id, 1.0, None)
        assert gap_m > spec.collision.margin_m + 0.02


def test_cameras_see_nothing_of_the_robot(spec, model):
    world = World(task=load_task("lid"), robot=spec, seed=0)
    directions = np.random.default_rng(0).normal(size=(3000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions = directions[directions[:, 0] > np.cos(EDGE_OF_VIEW_RAD)]
    *_, (_, q_pot) = _follow_the_way(WholeBodyRetargeter(model), pose_from_wire(spec.T_world_start))
    for q in (spec.start_positions, q_pot):
        for joint, position in zip(spec.joints, q, strict=True):
            world.data.joint(f"robot_{joint.name}").qpos[0] = position
        mujoco.mj_kinematics(world.model, world.data)
        for eye in EYES:
            seen = _look(world, eye, directions)
            assert any(name.startswith("gripper") for name in seen)
            assert not [name for name in seen if name.startswith("robot")]


def test_lid_motion_is_followed_with_room_to_spare(spec, model):
    retargeter = WholeBodyRetargeter(model)
    T_start = pose_from_wire(spec.T_world_start)
    moving = [i for i, joint in enumerate(spec.joints) if joint.name.startswith(("waist", "r_"))]
    for T_wanted, q in _follow_the_way(retargeter, T_start):
        error_m, error_rad = distance(T_wanted, model.compute_tool_pose(q))
        assert error_m < 0.003
        assert error_rad < 0.01
        room = np.minimum(q - model.lower, model.upper - q)
        assert room[moving].min() > 0.1


def test_start_is_where_the_posture_rests(spec, model):
    retargeter = WholeBodyRetargeter(model)
    T = pose_from_wire(spec.T_world_start)
    for _ in range(200):
        positions = retargeter.follow(TickReference(T, T, np.zeros(6))).positions
        assert positions == pytest.approx(spec.start_positions, abs=1e-3)


def test_arm_holds_still_and_comes_back_from_a_hard_push(spec):
    world = World(task=load_task("lid"), robot=spec, seed=0)
    T_start = pose_from_wire(spec.T_world_start)

    def worst_error_m(ticks):
        errors = []
        for _ in range(ticks):
            world.advance(TICK_S)
            errors.append(distance(T_start, world.T_world_tool)[0])
        return max(errors)

    assert worst_error_m(200) < 0.0003
    # Servos that are at their torque limits lose their damping: too high a gain never recovers.
    hand = world.model.body("gripper_base").id
    world.data.xfrc_applied[hand, 2] = 120.0
    assert worst_error_m(30) > 0.02
    world.data.xfrc_applied[hand, 2] = 0.0
    worst_error_m(100)
    assert worst_error_m(50) < 0.0003
