"""Spot: published figures, its start, what it may touch and see, and that its feet stay."""

import math

import mujoco
import numpy as np
import pytest

from common.clock import TICK_S
from common.robots import load_robot
from common.robots.compile import compile_robot, compute_tool_pose
from common.se3 import distance, invert, pose_from_wire
from common.tasks import load_task
from services.sim.world import World

SPOT = load_robot("spot")
ARM = ["sh0", "sh1", "el0", "el1", "wr0", "wr1"]
EYES_X_M = 0.06
FLANGE_X_M = 0.04

# Mass [kg] and centre of mass [m] of the manufacturer's description, and what was added to reach
# the published weights.
LINKS = {
    "base": (16.7077 + 1.0, [0, 0, -0.00496172]),
    "fl_hip": (1.13688, [-0.0158674, 0.00855842, 9.03e-06]),
    "hr_hip": (1.13688, [0.0158674, -0.00855842, 9.03e-06]),
    "fl_thigh": (2.2562, [0.00214442, -0.0111018, -0.078812]),
    "fr_thigh": (2.2562, [0.00214442, 0.0111018, -0.078812]),
    "hl_shank": (0.33, [0.0059736, 0, -0.174664]),
    "arm_0": (1.9047 + 0.5326, [-0.008399, 0.000272, -0.024603]),
    "arm_1": (1.85702, [0.0808491, -0.00167243, 0.00045644]),
    "arm_2": (0.94832, [0.0447662, -0.0027113, 0.0499136]),
    "arm_3": (1.01755, [-0.168671, -0.0161612, 1.149e-05]),
    "arm_4": (0.582637, [0.00952465, -0.0114441, 1.86e-06]),
    "arm_5": (0.933353, [0.0975128, 9.265e-05, -0.0112052]),
    "jaw": (0.223833, [0.0356518, 0.000672, -0.0122752]),
}

# Trace of the inertia [kg m2], which does not depend on the axes; the first and the seventh grow
# with the mass that was added.
INERTIA_TRACES = {
    "base": (0.0815438 + 0.549231 + 0.569454) * (17.7077 / 16.7077),
    "fl_hip": 0.001221661 + 0.001589575 + 0.001729034,
    "hr_thigh": 0.02692499 + 0.0258391 + 0.003187374,
    "fr_shank": 0.007013556 + 0.00709946 + 0.0001452902,
    "arm_0": (0.008896 + 0.004922002 + 0.007302998) * (2.4373 / 1.9047),
    "arm_1": 0.002615255 + 0.02703873 + 0.02819929,
    "arm_3": 0.001177092 + 0.01649387 + 0.01689896,
    "arm_5": 0.0009883604 + 0.001970178 + 0.001657912,
}

RANGES = {
    "body_x": (-0.3, -0.1),
    "body_y": (-0.065, 0.065),
    "body_z": (0.38, 0.5),
    "body_yaw": (-math.pi / 16, math.pi / 16),
    "body_pitch": (-math.pi / 16, math.pi / 16),
    "body_roll": (-math.pi / 16, math.pi / 16),
    "arm_sh0": (-2.61799, 3.14159),
    "arm_sh1": (-3.14159, 0.523599),
    "arm_el0": (0.0, 3.14159),
    "arm_el1": (-2.79253, 2.79253),
    "arm_wr0": (-1.8326, 1.8326),
    "arm_wr1": (-2.87989, 2.87979),
    "fl_hx": (-0.785398, 0.785398),
    "hr_hy": (-0.898845, 2.29511),
    "hl_kn": (-2.7929, -0.2471),
}


@pytest.fixture(scope="module")
def mj() -> mujoco.MjModel:
    return compile_robot(SPOT)


def _feet_error_m(data: mujoco.MjData) -> float:
    return max(
        float(np.linalg.norm(data.site(f"robot_{leg.foot_site}").xpos - leg.foothold))
        for leg in SPOT.legs
    )


@pytest.mark.parametrize("name", LINKS)
def test_links_weigh_what_is_published(mj, name):
    mass_kg, com_m = LINKS[name]
    assert mj.body(name).mass[0] == pytest.approx(mass_kg, abs=1e-5)
    assert mj.body(name).ipos == pytest.approx(com_m, abs=1e-9)


def test_inertias_are_the_published_ones(mj):
    for name, trace in INERTIA_TRACES.items():
        assert mj.body(name).inertia.sum() == pytest.approx(trace, rel=1e-4), name


def test_robot_and_arm_weigh_what_the_manufacturer_says(mj):
    assert mj.body("arm_0").subtreemass[0] == pytest.approx(8.0, abs=1e-3)
    assert mj.body("base").subtreemass[0] == pytest.approx(32.6 + 8.0, abs=1e-3)
    assert (mj.body_gravcomp[1:] == 1.0).all()


@pytest.mark.parametrize("name", RANGES)
def test_joint_ranges_are_the_published_ones(mj, name):
    assert mj.joint(name).range == pytest.approx(RANGES[name], abs=1e-6)


def test_arm_efforts_are_the_published_ones():
    arm = [joint.torque_limit for joint in SPOT.joints[6:]]
    assert arm == [90.9, 181.8, 90.9, 30.3, 30.3, 30.3]


def test_neutral_posture_puts_hand_and_foot_where_the_reference_says(mj):
    neutral = [-0.2, 0, 0.4, 0, 0, 0, 0, -0.66 * math.pi, 0.66 * math.pi, 0, 0, 0]
    T_world_tool = compute_tool_pose(SPOT, mj, neutral)
    assert T_world_tool[:3, 3] == pytest.approx([0.53223, 0.0, 0.92963], abs=1e-5)
    assert T_world_tool[:3, :3] == pytest.approx(np.eye(3), abs=1e-9)
    data = mujoco.MjData(mj)
    for name, value in {"body_x": -0.2, "body_z": 0.4, "fl_hy": 0.23 * math.pi}.items():
        data.joint(name).qpos[0] = value
    data.joint("fl_kn").qpos[0] = -math.pi / 2
    mujoco.mj_kinematics(mj, data)
    assert data.site("foot_fl").xpos == pytest.approx([0.15219, 0.16595, -0.075176], abs=1e-5)


def test_start_is_exact_and_has_margins(mj):
    T_world_tool = compute_tool_pose(SPOT, mj, SPOT.start_positions)
    error_m, error_rad = distance(pose_from_wire(SPOT.T_world_start), T_world_tool)
    assert error_m < 1e-9
    assert error_rad < 1e-9
    ranges = np.array([mj.joint(joint.name).range for joint in SPOT.joints])
    q = np.array(SPOT.start_positions)
    margins = np.minimum(q - ranges[:, 0], ranges[:, 1] - q)
    assert margins[:6].min() > 0.02
    assert margins[6:].min() > 0.22
    assert np.sort(margins[6:])[1] > 0.75


def test_arm_alone_can_move_the_hand_at_the_start(mj):
    data = mujoco.MjData(mj)
    for joint in SPOT.joints:
        data.joint(joint.name).qpos[0] = joint.start
    mujoco.mj_forward(mj, data)
    J = np.zeros((6, mj.nv))
    mujoco.mj_jacSite(mj, data, J[:3], J[3:], mj.site("tool").id)
    arm = [int(mj.joint(f"arm_{name}").dofadr[0]) for name in ARM]
    assert np.linalg.svd(J[:, arm], compute_uv=False)[-1] > 0.2


def test_legs_touch_nothing_and_the_rest_touches_only_the_scene(mj):
    legs = np.array([str(mj.body(b).name)[:2] in ("fl", "fr", "hl", "hr") for b in mj.geom_bodyid])
    assert legs.sum() == 4 * 6
    assert not mj.geom_contype[legs].any()
    assert not mj.geom_conaffinity[legs].any()
    assert (mj.geom_contype[~legs] == 2).all()
    assert (mj.geom_conaffinity[~legs] == 1).all()


def test_nothing_of_the_robot_is_in_front_of_the_cameras():
    world = World(task=load_task("lid"), robot=SPOT, seed=0)
    model, data = world.model, world.data
    T_tool_world = invert(world.T_world_tool)
    for geom in range(model.ngeom):
        if not model.geom(geom).name.startswith("robot_"):
            continue
        R = data.geom_xmat[geom].reshape(3, 3)
        centre = data.geom_xpos[geom] + R @ model.geom_aabb[geom, :3]
        reach = np.abs(T_tool_world[0, :3] @ R) @ model.geom_aabb[geom, 3:]
        front_m = T_tool_world[0] @ [*centre, 1.0] + reach
        hand = model.body(model.geom_bodyid[geom]).name in ("robot_arm_5", "robot_jaw")
        assert front_m < (FLANGE_X_M if hand else EYES_X_M), model.geom(geom).name


def test_own_geoms_that_are_kept_apart_are_apart_at_the_start():
    world = World(task=load_task("lid"), robot=SPOT, seed=0)
    fromto = np.zeros(6)
    for one, other in SPOT.collision.pairs:
        ids = [world.model.geom(f"robot_{name}").id for name in (one, other)]
        gap_m = mujoco.mj_geomDistance(world.model, world.data, *ids, 1.0, fromto)
        assert gap_m > SPOT.collision.margin_m + 0.02, (one, other)


def test_holds_still_for_two_seconds():
    world = World(task=load_task("lid"), robot=SPOT, seed=0)
    T_world_start = pose_from_wire(SPOT.T_world_start)
    for _ in range(200):
        world.advance(TICK_S)
        error_m, error_rad = distance(T_world_start, world.T_world_tool)
        assert error_m < 3e-4
        assert error_rad < 3e-4
        assert _feet_error_m(world.data) < 1e-9


def test_legs_are_bent_from_outside_and_cost_no_joints():
    world = World(task=load_task("lid"), robot=SPOT, seed=0)
    names = {world.model.joint(joint).name for joint in range(world.model.njnt)}
    assert {f"robot_{joint.name}" for joint in SPOT.joints} <= names
    assert not names & {f"robot_{name}" for name in SPOT.leg_joints}


def test_feet_stay_while_the_body_moves_through_its_range(mj):
    world = World(task=load_task("lid"), robot=SPOT, seed=0)
    ranges = np.array([mj.joint(joint.name).range for joint in SPOT.joints[:6]])
    middle, half = ranges.mean(axis=1), 0.5 * (ranges[:, 1] - ranges[:, 0])
    start = np.array(SPOT.start_positions)
    offset = np.arcsin((start[:6] - middle) / half)
    turns_per_s = np.array([2.0, 2.3, 2.6, 2.9, 3.2, 3.5])
    seen: list[list[float]] = []
    for tick in range(1, 401):
        t = tick * TICK_S
        # The phase starts gently, so that the servos are not thrown off at the start.
        phase, rate = t * t / (t + 0.5), 1.0 - 0.25 / (t + 0.5) ** 2
        angle = offset + turns_per_s * phase
        q = [*(middle + half * np.sin(angle)), *start[6:]]
        v = [*(half * np.cos(angle) * turns_per_s * rate), *np.zeros(6)]
        # The arm turns aside: the hand would meet the table when the body bows.
        q[6] -= 0.85 * min(t, 1.0)
        v[6] = -0.85 if t < 1.0 else 0.0
        world.servos.command(q, v)
        world.advance(TICK_S)
        assert _feet_error_m(world.data) < 1e-9
        seen.append(world.servos.positions(world.data)[:6])
        assert np.abs(seen[-1] - np.array(q[:6])).max() < 2e-3
    swept = np.ptp(seen, axis=0)
    assert (swept > 1.9 * half).all()
