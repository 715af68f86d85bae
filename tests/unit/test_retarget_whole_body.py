"""The whole-body retargeter: it arrives, stays, recovers and repeats itself."""

import re
import subprocess
import sys

import mujoco
import numpy as np
import pytest

from common.errors import BadRobotFile
from common.robots import load_robot
from common.se3 import apply_differential, distance, make_pose, pose_to_wire
from services.retarget.robot_model import RobotModel
from services.retarget.whole_body import WholeBodyRetargeter
from tests.retarget_runs import follow_actions, make_panda, rest, wandering_actions

START = load_robot("panda").start_positions


def test_a_reachable_pose_is_reached_and_held():
    panda = make_panda()
    T = apply_differential(panda.compute_tool_pose(START), [0.25, 0.1, 0.1], [0.1, 0.6, 0.2])
    errors = []
    for _ in range(400):
        motion = panda.follow(rest(T))
        errors.append(distance(panda.compute_tool_pose(motion.positions), T))
    assert max(errors[-1]) < 1e-9
    # Shaping brakes in time: hardly any overshoot after the first arrival.
    arrived = next(k for k, (e, _) in enumerate(errors) if e < 1e-3)
    assert max(e for e, _ in errors[arrived:]) < 2e-3


def test_a_smooth_tour_is_followed_closely():
    panda = make_panda()
    errors = [
        distance(tick.T_world_end, panda.compute_tool_pose(q))
        for tick, q in follow_actions(panda, list(wandering_actions(100)), START)
    ]
    position, rotation = np.array(errors).T
    assert np.sqrt((position**2).mean()) < 2e-3
    assert np.sqrt((rotation**2).mean()) < 5e-3


def test_sixty_seconds_of_rest_do_not_creep():
    panda = make_panda()
    bent = [value + 0.02 * (-1) ** k for k, value in enumerate(START)]
    T = panda.compute_tool_pose(bent)
    panda.start(bent)
    for _ in range(3000):
        motion = panda.follow(rest(T))
    settled = np.array(motion.positions)
    for _ in range(3000):
        motion = panda.follow(rest(T))
        assert np.abs(np.array(motion.positions) - settled).max() < 1e-6
    assert max(distance(panda.compute_tool_pose(motion.positions), T)) < 1e-6


def test_posture_is_reached_without_moving_the_hand():
    panda = make_panda()
    # The same tool pose with another elbow: along the null space from the start.
    q = np.array(START)
    model = RobotModel(load_robot("panda"))
    T = model.compute_tool_pose(q)
    for _ in range(40):
        q = q + 0.01 * np.linalg.svd(model.compute_hand(q)[1])[2][6]
    T = model.compute_tool_pose(q)
    panda.start(q.tolist())
    for _ in range(500):
        motion = panda.follow(rest(T))
        assert max(distance(panda.compute_tool_pose(motion.positions), T)) < 1e-3
    away = np.abs(q - START).max()
    assert np.abs(np.array(motion.positions) - START).max() < 0.2 * away
    assert motion.velocities == pytest.approx([0.0] * 7, abs=1e-6)


def test_an_unreachable_pose_is_approached_and_reported():
    panda = make_panda()
    T = apply_differential(panda.compute_tool_pose(START), [1.5, 0.0, 0.0], [0.0, 0.0, 0.0])
    far = distance(panda.compute_tool_pose(START), T)[0]
    for _ in range(400):
        motion = panda.follow(rest(T))
    assert distance(panda.compute_tool_pose(motion.positions), T)[0] < far - 0.4
    assert motion.scaling[0] < 0.5
    assert set(motion.active_limits) <= {f"joint{k}" for k in range(1, 8)}
    assert motion.failures == 0


def test_inputs_and_outputs_are_copies():
    panda = make_panda()
    T = panda.compute_tool_pose(START)
    positions = list(START)
    panda.start(positions)
    first = panda.follow(rest(T))
    kept = list(first.positions)
    first.positions[0] = positions[0] = 99.0
    second = panda.follow(rest(T))
    assert second.positions == pytest.approx(kept, abs=1e-4)


def test_a_hand_needs_six_joints(tmp_path):
    spec = load_robot("panda")
    xml = spec.model_path.read_text()
    for name in ("joint6", "joint7"):
        xml = re.sub(f'<joint name="{name}"[^/]*/>', "", xml)
    (tmp_path / "model.xml").write_text(xml)
    T_world_start = _compute_start(tmp_path)
    short = spec.model_copy(
        update={"joints": spec.joints[:5], "folder": tmp_path, "T_world_start": T_world_start}
    )
    with pytest.raises(BadRobotFile, match="cannot move a hand freely"):
        RobotModel(short)


def _compute_start(folder):
    mj = mujoco.MjModel.from_xml_path(str(folder / "model.xml"))
    data = mujoco.MjData(mj)
    data.qpos[:] = START[:5]
    mujoco.mj_kinematics(mj, data)
    tool = data.site("tool")
    return tuple(pose_to_wire(make_pose(tool.xmat.reshape(3, 3), tool.xpos)))


_RUN = """
import hashlib, sys
import numpy as np
# Shift where numpy's and the allocator's memory begins.
keep = [np.zeros(int(size)) for size in sys.argv[1:]]
from tests.retarget_runs import jumping_references, make_panda
panda = make_panda()
digest = hashlib.sha256()
for reference in jumping_references(np.random.default_rng(7), 600):
    motion = panda.follow(reference)
    digest.update(np.array(motion.positions + motion.velocities + motion.scaling).tobytes())
print(digest.hexdigest())
"""


def test_two_processes_give_the_same_bits():
    digests = {
        subprocess.run(
            [sys.executable, "-c", _RUN, *sizes], capture_output=True, text=True, check=True
        ).stdout
        for sizes in ([], ["1", "3", "77", "1001"])
    }
    assert len(digests) == 1


def test_a_restart_forgets_everything():
    panda = make_panda()
    runs = []
    for _ in range(2):
        panda.start(START)
        T = apply_differential(panda.compute_tool_pose(START), [0.4, 0.3, 0.1], [0.2, 0.9, 0.5])
        runs.append([panda.follow(rest(T)).positions for _ in range(150)])
    fresh = WholeBodyRetargeter(RobotModel(load_robot("panda")))
    runs.append([fresh.follow(rest(T)).positions for _ in range(150)])
    assert runs[0] == runs[1] == runs[2]
