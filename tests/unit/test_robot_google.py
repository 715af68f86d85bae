"""The Google Robot: its published figures, its start, and that base and arm carry one hand."""

import math
from dataclasses import dataclass

import mujoco
import numpy as np
import pytest

from common.calibration import R_TOOL_CAMERA, load_calibration
from common.clock import TICK_S
from common.robots import load_robot
from common.robots.compile import compile_robot, compute_tool_pose
from common.se3 import distance, exp3, make_pose, matrix_from_quat, pose_from_wire
from common.tasks import load_task
from services.policy.min_jerk import MinJerkSegment
from services.retarget.reference import WaypointInterpolator
from services.retarget.retargeter import Motion
from services.retarget.whole_body import RobotModel, WholeBodyRetargeter
from services.sim.world import World

# Mass [kg], centre of mass [m] and diagonal of the inertia about it [kg m2] in body axes.
INERTIALS = {
    "base_link": (55.207804, (-0.13402, 0.00218, 0.16714), (5.137824, 5.690219, 1.460404)),
    "link_torso": (1.8957478, (-0.00349, -0.06071, 0.11176), (0.0133075, 0.0067047, 0.0114604)),
    "link_shoulder": (1.8471938, (0.00108, 0.00481, 0.10494), (0.0139748, 0.0142492, 0.0029468)),
    "link_bicep": (1.2474204, (0.00041, -0.02114, 0.13524), (0.0070468, 0.0068874, 0.0018545)),
    "link_elbow": (0.64638468, (0.00173, -0.07657, 0.03671), (0.0017867, 0.0011849, 0.0013175)),
    "link_forearm": (0.72436658, (0.00001, 0.01509, 0.18181), (0.0072105, 0.0071575, 0.0005916)),
    "link_wrist": (0.50192933, (-0.00030, -0.00733, 0.05366), (0.0011426, 0.0010700, 0.0004271)),
    "link_gripper": (0.40507013, (0.00042, 0.00012, 0.03790), (0.0002924, 0.0002636, 0.0003114)),
}
RANGES = {
    "base_x": (-0.6, 0.0),
    "base_y": (-0.2, 0.4),
    "base_yaw": (-np.pi, np.pi),
    "joint_torso": (-4.49, 1.35),
    "joint_shoulder": (-2.66, 3.18),
    "joint_bicep": (-2.13, 3.71),
    "joint_elbow": (-2.05, 3.79),
    "joint_forearm": (-2.92, 2.92),
    "joint_wrist": (-1.79, 1.79),
    "joint_gripper": (-4.49, 1.35),
}
ARM_VELOCITIES = [2.0, 2.0, 2.0, 2.5, 3.0, 3.0, 3.0]
ARM_TORQUES = [150.0, 150.0, 30.0, 30.0, 30.0, 30.0, 30.0]


@pytest.fixture(scope="module")
def spec():
    return load_robot("google")


@pytest.fixture(scope="module")
def mj(spec):
    return compile_robot(spec)


@dataclass(frozen=True)
class _Journey:
    """A way over the pot in the simulation: ahead, left, up and 40 degrees pitched down."""

    world: World
    motions: list[Motion]
    errors_m: list[float]


@pytest.fixture(scope="module")
def journey(spec):
    T_start = pose_from_wire(spec.T_world_start)
    T_end = make_pose(exp3([0.0, math.radians(40.0), 0.0]), [0.48, -0.02, 1.02])
    way = MinJerkSegment(T_start, T_end, speed_m_s=0.25, turn_rad_s=1.2, period_s=0.1)
    retargeter = WholeBodyRetargeter(RobotModel(spec))
    retargeter.start(spec.start_positions)
    reference = WaypointInterpolator(T_start)
    world = World(task=load_task("lid"), robot=spec, seed=0)
    motions, errors_m = [], []
    for step in range(1, way.steps + 1):
        reference.aim(way.pose(step))
        for _ in range(10):
            tick = reference.advance()
            motions.append(retargeter.follow(tick))
            world.servos.command(motions[-1].positions, motions[-1].velocities)
            world.advance(TICK_S)
            errors_m.append(distance(world.T_world_tool, tick.T_world_end)[0])
    return _Journey(world, motions, errors_m)


def test_inertials_are_the_published_ones(mj):
    assert [mj.body(b).name for b in range(1, mj.nbody)] == list(INERTIALS)
    for name, (mass_kg, com_m, inertia) in INERTIALS.items():
        body = mj.body(name)
        assert body.mass[0] == pytest.approx(mass_kg, abs=1e-8)
        assert body.ipos == pytest.approx(com_m, abs=6e-6)
        R = matrix_from_quat(body.iquat)
        assert np.diag(R * body.inertia @ R.T) == pytest.approx(inertia, rel=2e-4)


def test_mass_is_that_of_the_published_model_without_its_fingers(mj):
    assert mj.body_mass.sum() == pytest.approx(62.4759, abs=1e-4)
    assert (mj.body_gravcomp[1:] == 1.0).all()


def test_ranges_and_limits_are_the_published_ones(spec, mj):
    assert [joint.name for joint in spec.joints] == list(RANGES)
    for name, limits in RANGES.items():
        assert mj.joint(name).range == pytest.approx(limits, abs=1e-8)
    assert [joint.velocity_limit for joint in spec.joints[3:]] == ARM_VELOCITIES
    assert [joint.acceleration_limit for joint in spec.joints[3:]] == [2.0] * 7
    assert [joint.torque_limit for joint in spec.joints[3:]] == ARM_TORQUES


def test_tool_at_the_neutral_posture_is_where_the_paper_has_it(spec, mj):
    neutral = [-0.3, 0.1, 0.0, 0.0, np.pi / 8, 0.0, 5 * np.pi / 8, 0.0, -np.pi / 4, np.pi / 2]
    T_world_tool = compute_tool_pose(spec, mj, neutral)
    assert T_world_tool[:3, 3] == pytest.approx([0.32026, -0.23, 0.88111], abs=1e-5)
    assert T_world_tool[:3, :3] == pytest.approx(np.eye(3), abs=1e-9)
    # That posture turns the gripper joint past its own limit, so that it cannot be our bias.
    assert neutral[-1] > mj.joint("joint_gripper").range[1] + 0.2


def test_start_is_exact_and_has_margins(spec, mj):
    q = np.array(spec.start_positions)
    T_world_tool = compute_tool_pose(spec, mj, spec.start_positions)
    assert max(distance(pose_from_wire(spec.T_world_start), T_world_tool)) < 1e-9
    margins = np.minimum(q - mj.jnt_range[:, 0], mj.jnt_range[:, 1] - q)
    assert margins[:2].min() > 0.2
    assert margins[3:].min() > 0.5
    assert q[:3] == pytest.approx([-0.3, 0.1, 0.0], abs=0.1)
    assert [joint.bias for joint in spec.joints] == spec.start_positions


def test_hand_can_move_every_way_without_the_base(spec, mj):
    data = mujoco.MjData(mj)
    data.qpos[:] = spec.start_positions
    mujoco.mj_forward(mj, data)
    J = np.zeros((6, mj.nv))
    mujoco.mj_jacSite(mj, data, J[:3], J[3:], mj.site("tool").id)
    assert np.linalg.svd(J[:, 3:], compute_uv=False)[-1] > 0.05


def test_robot_meets_the_scene_but_not_itself_nor_the_floor(mj):
    solid = mj.geom_contype > 0
    assert (mj.geom_contype[solid] == 2).all()
    assert (mj.geom_conaffinity[solid] == 1).all()
    assert (mj.geom_conaffinity[~solid] == 0).all()
    drawn = {mj.geom(g).name for g in np.flatnonzero(~solid)}
    assert drawn == {"wheel_left", "wheel_right", "caster_left", "caster_right"}
    data = mujoco.MjData(mj)
    mujoco.mj_kinematics(mj, data)
    for geom in np.flatnonzero(solid & (mj.geom_bodyid == mj.body("base_link").id)):
        assert _lowest_m(mj, data, geom) > 0.02


def test_wheels_and_casters_stand_on_the_floor(mj):
    data = mujoco.MjData(mj)
    mujoco.mj_kinematics(mj, data)
    for geom in np.flatnonzero(mj.geom_contype == 0):
        assert _lowest_m(mj, data, geom) == pytest.approx(0.0, abs=1e-3)


def test_collision_pairs_are_apart_at_the_start_and_no_neighbours(spec, mj):
    data = mujoco.MjData(mj)
    data.qpos[:] = spec.start_positions
    mujoco.mj_kinematics(mj, data)
    assert all(mj.geom(g).name for g in range(mj.ngeom))
    least = spec.collision.margin_m + 0.02
    for names in spec.collision.pairs:
        a, b = (mj.geom(name) for name in names)
        bodies = int(a.bodyid[0]), int(b.bodyid[0])
        assert abs(bodies[0] - bodies[1]) > 1
        assert mujoco.mj_geomDistance(mj, data, a.id, b.id, 1.0, None) > least


def test_cameras_see_nothing_of_the_robot_at_the_start(spec):
    assert _seen_by_cameras(World(task=load_task("lid"), robot=spec, seed=0)) == set()


def test_cameras_see_nothing_of_the_robot_over_the_pot(journey):
    assert _seen_by_cameras(journey.world) == set()


def test_hand_holds_still_at_the_start(spec):
    world = World(task=load_task("lid"), robot=spec, seed=0)
    for _ in range(200):
        world.servos.command(spec.start_positions, [0.0] * spec.nv)
        world.advance(TICK_S)
        assert distance(world.T_world_tool, pose_from_wire(spec.T_world_start))[0] < 3e-4


def test_base_and_arm_take_the_hand_over_the_pot(spec, journey):
    assert np.median(journey.errors_m) < 2e-3
    assert np.quantile(journey.errors_m, 0.95) < 6e-3
    base = np.array(journey.motions[-1].positions[:2]) - spec.start_positions[:2]
    assert np.hypot(*base) > 0.1
    touching = journey.world.data.contact.geom.ravel()
    names = [journey.world.model.geom(geom).name for geom in touching]
    assert not [name for name in names if name.startswith("robot_")]


def test_limits_hold_on_the_way(spec, mj, journey):
    q = np.array([motion.positions for motion in journey.motions])
    v = np.array([motion.velocities for motion in journey.motions])
    a = np.diff(v, axis=0, prepend=0.0) / TICK_S
    assert (q >= mj.jnt_range[:, 0] - 1e-12).all()
    assert (q <= mj.jnt_range[:, 1] + 1e-12).all()
    assert (np.abs(v) <= [joint.velocity_limit + 1e-9 for joint in spec.joints]).all()
    assert (np.abs(a) <= [joint.acceleration_limit + 1e-6 for joint in spec.joints]).all()
    q_arm, ranges = q[:, 3:], mj.jnt_range[3:]
    assert np.minimum(q_arm - ranges[:, 0], ranges[:, 1] - q_arm).min() > 0.3


def _seen_by_cameras(world) -> set[str]:
    """Geoms of the robot that rays through every fourth pixel of both eyes meet."""
    calibration = load_calibration("t265")
    pixels = calibration.pixel_directions()[~calibration.outside_circle()][::4]
    T_world_tool = world.T_world_tool
    rays = (pixels @ (T_world_tool[:3, :3] @ R_TOOL_CAMERA).T).ravel()
    seen: set[str] = set()
    for p_tool_eye in (calibration.p_tool_left_m, calibration.p_tool_right_m):
        p_world_eye = (T_world_tool @ [*p_tool_eye, 1.0])[:3]
        hits = np.full(len(pixels), -1, dtype=np.int32)
        ranges_m = np.zeros(len(pixels))
        mujoco.mj_multiRay(
            world.model,
            world.data,
            p_world_eye,
            rays,
            None,
            True,
            -1,
            hits,
            ranges_m,
            None,
            len(pixels),
            mujoco.mjMAXVAL,
        )
        assert (hits >= 0).any()
        seen |= {world.model.geom(geom).name for geom in hits[hits >= 0]}
    return {name for name in seen if name.startswith("robot_")}


def _lowest_m(mj, data, geom) -> float:
    """Height of the lowest corner of a geom's bounding box."""
    centre, half = mj.geom_aabb[geom, :3], mj.geom_aabb[geom, 3:]
    z = data.geom_xmat[geom].reshape(3, 3)[2]
    return float(data.geom_xpos[geom, 2] + z @ centre - np.abs(z) @ half)
