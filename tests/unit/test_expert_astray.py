"""The expert goes on from where the gripper is, not from where it was sent."""

import numpy as np

from common.messages import GroundTruth, Header, StereoFrame
from common.se3 import Array, apply_differential, distance, make_pose, pose_to_wire
from common.tasks import load_task
from services.policy.expert import ExpertPolicy
from services.policy.policy import Observation

TRUTH = {
    item.name: pose_to_wire(item.T_world_object)
    for item in load_task("lid").spawn(np.random.default_rng(0))
}
START = make_pose(np.eye(3), [0.1, -0.3, 0.8])


def seen(T_world_tool: Array, step: int) -> Observation:
    header = Header(cell="a", step=step)
    frame = StereoFrame(
        header=header, camera="t265", width=1, height=1, left=b"0", right=b"0", due_step=step
    )
    wire = pose_to_wire(T_world_tool)
    truth = GroundTruth(header=header, T_world_tool=wire, objects=TRUTH, opening_m=0.1)
    return Observation(frame, truth)


def final_pose(*, stuck_after: int, frames: int = 60) -> Array:
    """Where a hand ends that follows, but for its first frames when it does not move."""
    expert = ExpertPolicy()
    expert.reset(seed=1, task="lid")
    T_hand = START
    for frame in range(frames):
        (step,) = expert.act(seen(T_hand, 10 * frame))
        if step.grasp:
            break
        if frame >= stuck_after:
            T_hand = apply_differential(T_hand, step.translation_m, step.rotation_rad)
    return T_hand


def test_a_hand_that_was_held_up_still_gets_to_the_lid():
    follows, was_stuck = final_pose(stuck_after=0), final_pose(stuck_after=12)
    lost_m, lost_rad = distance(follows, was_stuck)
    assert lost_m < 0.01
    assert lost_rad < 0.05
