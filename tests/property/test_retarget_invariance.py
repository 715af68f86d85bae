"""Moving the whole world by a rigid motion changes nothing; neither does asking twice."""

from xml.etree import ElementTree

import numpy as np
import pytest

from common.robots import WallSpec, load_robot
from common.se3 import apply_differential, exp3, make_pose, pose_from_wire, pose_to_wire
from services.retarget.reference import TickReference
from services.retarget.robot_model import RobotModel
from services.retarget.whole_body import WholeBodyRetargeter
from tests.retarget_runs import BODIES, jumping_references, rest

TICKS = 300


def _move_robot(spec, T, folder):
    """The robot, its walls and its start pose, all moved by T (4, 4)."""
    tree = ElementTree.parse(spec.model_path)
    for body in tree.getroot().findall("worldbody/body"):
        pos = [float(value) for value in body.get("pos", "0 0 0").split()]
        quat = [float(value) for value in body.get("quat", "1 0 0 0").split()]
        wire = pose_to_wire(T @ pose_from_wire([*pos, *quat]))
        body.set("pos", " ".join(repr(float(value)) for value in wire[:3]))
        body.set("quat", " ".join(repr(float(value)) for value in wire[3:]))
    tree.write(folder / "model.xml")
    R, p = T[:3, :3], T[:3, 3]
    walls = tuple(
        wall.model_copy(
            update={
                "point": tuple(R @ wall.point + p),
                "normal": tuple(R @ wall.normal),
            }
        )
        for wall in spec.walls
    )
    start = tuple(pose_to_wire(T @ pose_from_wire(spec.T_world_start)))
    return spec.model_copy(update={"folder": folder, "T_world_start": start, "walls": walls})


def _move_reference(reference, T):
    R = T[:3, :3]
    twist = np.concatenate([R @ reference.twist[:3], R @ reference.twist[3:]])
    return TickReference(T @ reference.T_world_start, T @ reference.T_world_end, twist)


@pytest.mark.parametrize("name", BODIES)
def test_a_rigid_motion_of_the_world_changes_nothing(name, tmp_path):
    wall = WallSpec(name="wall", point=(0.3, -0.2, 0.9), normal=(0.6, 0.0, 0.8))
    spec = load_robot(name).model_copy(update={"walls": (wall,)})
    T = make_pose(exp3([0.3, -0.2, 1.1]), [0.5, -0.25, 0.125])
    here = WholeBodyRetargeter(RobotModel(spec))
    there = WholeBodyRetargeter(RobotModel(_move_robot(spec, T, tmp_path)))
    limited = 0
    for reference in jumping_references(np.random.default_rng(2), TICKS):
        # From the same state in every tick: wild targets amplify what rounding leaves.
        there._q, there._a = here._q, here._a
        one = here.follow(reference)
        other = there.follow(_move_reference(reference, T))
        assert other.velocities == pytest.approx(one.velocities, abs=1e-7)
        limited += bool(one.active_limits)
    assert limited > TICKS // 4


@pytest.mark.parametrize("name", BODIES)
def test_posture_settings_never_change_the_hand(name):
    """Another posture, gain and weights: the hand's velocity is the same in every tick."""
    spec = load_robot(name)
    joints = tuple(
        joint.model_copy(update={"bias": joint.start + 0.02, "level2_weight": 1.0 + i % 3})
        for i, joint in enumerate(spec.joints)
    )
    gains = spec.retarget.model_copy(update={"posture_gain_per_s": 2.0})
    one = WholeBodyRetargeter(RobotModel(spec))
    other_spec = spec.model_copy(update={"joints": joints, "retarget": gains})
    model = RobotModel(other_spec)
    other = WholeBodyRetargeter(model)
    most, differ = 0.0, 0.0
    random = np.random.default_rng(4)
    for tick in range(TICKS):
        if tick % 30 == 0:
            T = apply_differential(
                one.T_world_hand,
                random.uniform(-0.1, 0.1, 3).tolist(),
                random.uniform(-0.3, 0.3, 3).tolist(),
            )
        # Both start every tick in the same state.
        other._q, other._a = one._q, one._a
        J = model.compute_hand(one._q)[1].copy()
        a = np.array(one.follow(rest(T)).velocities)
        a_other = np.array(other.follow(rest(T)).velocities)
        most = max(most, float(np.abs(J @ (a - a_other)).max()))
        differ = max(differ, float(np.abs(a - a_other).max()))
    assert most <= 1e-6
    # The posture does have something to say.
    assert differ > 1e-3
