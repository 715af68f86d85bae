"""The disturbed demonstrator: it says what it meant, and gets there all the same."""

import numpy as np

from common.messages import ActionStep, GroundTruth, Header, StereoFrame
from common.se3 import Array, apply_differential, distance, make_pose, pose_to_wire
from common.tasks import load_task
from services.policy.disturbance import Disturbance
from services.policy.expert import ExpertPolicy
from services.policy.noisy_expert import NoisyExpertPolicy
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
    return Observation(
        frame, GroundTruth(header=header, T_world_tool=wire, objects=TRUTH, opening_m=0.1)
    )


def demonstrate(policy: ExpertPolicy, seed: int) -> tuple[list[ActionStep], Array]:
    """Steps until the gripper closes, and where it does."""
    policy.reset(seed=seed, task="lid")
    steps: list[ActionStep] = []
    T_hand = START
    for frame in range(120):
        (step,) = policy.act(seen(T_hand, 10 * frame))
        steps.append(step)
        if step.grasp:
            break
        T_hand = apply_differential(T_hand, step.translation_m, step.rotation_rad)
    return steps, T_hand


def seed_with_level(*, disturbed: bool) -> int:
    """A seed whose episode is disturbed, or not."""
    for seed in range(100):
        policy = NoisyExpertPolicy()
        policy.reset(seed=seed, task="lid")
        if (policy.disturbance.level > 0.0) == disturbed:
            return seed
    raise AssertionError("no such seed")


def test_what_is_done_differs_from_what_is_meant():
    steps, _ = demonstrate(NoisyExpertPolicy(), seed_with_level(disturbed=True))
    meant = [step.meant for step in steps if step.meant is not None]
    assert len(meant) > 20
    pushes = [
        np.subtract(step.translation_m, step.meant.translation_m)
        for step in steps
        if step.meant is not None
    ]
    lengths = np.linalg.norm(pushes, axis=1)
    assert lengths.max() > 0.002
    assert lengths.max() < 0.06


def test_it_closes_where_the_undisturbed_one_does():
    seed = seed_with_level(disturbed=True)
    (noisy, T_noisy), (_, T_plain) = (
        demonstrate(policy, seed) for policy in (NoisyExpertPolicy(), ExpertPolicy())
    )
    assert noisy[-1].grasp
    off_m, off_rad = distance(T_plain, T_noisy)
    assert off_m < 0.006
    assert off_rad < 0.04


def test_without_pushes_it_does_what_it_means():
    steps, _ = demonstrate(NoisyExpertPolicy(), seed_with_level(disturbed=False))
    meant = [(step, step.meant) for step in steps if step.meant is not None]
    assert len(meant) > 15
    for step, motion in meant:
        np.testing.assert_allclose(step.translation_m, motion.translation_m, atol=1e-12)
        np.testing.assert_allclose(step.rotation_rad, motion.rotation_rad, atol=1e-12)


def test_it_stands_still_for_its_fingers_only():
    seed = seed_with_level(disturbed=False)
    fluent, halting = (
        [np.linalg.norm(step.translation_m) for step in demonstrate(policy, seed)[0]]
        for policy in (NoisyExpertPolicy(), ExpertPolicy())
    )
    waits = 2  # 0.2 s over the bar, before the fingers close
    assert min(fluent[: -waits - 1]) > 0.002
    assert min(halting[: -waits - 1]) < 0.001


def test_the_seed_decides_the_pushes():
    seed = seed_with_level(disturbed=True)
    first, second = (demonstrate(NoisyExpertPolicy(), seed)[0] for _ in range(2))
    assert first == second


def test_what_is_meant_leads_back_to_the_path():
    """After a push the meant step is not the path's own: it takes part of the way back."""
    policy = NoisyExpertPolicy()
    steps, _ = demonstrate(policy, seed_with_level(disturbed=True))
    plain, _ = demonstrate(ExpertPolicy(), seed_with_level(disturbed=True))
    pairs = list(zip(steps, plain, strict=False))[3:20]
    off = [np.subtract(a.meant.translation_m, b.translation_m) for a, b in pairs if a.meant]
    assert np.linalg.norm(off, axis=1).max() > 1e-3


def test_pushes_grow_with_the_motion_and_end_at_rest():
    fast, slow = (
        np.std(
            [disturbance.draw(np.array([step_m, 0.0, 0.0]), np.zeros(3))[0] for _ in range(2000)]
        )
        for step_m, disturbance in ((0.03, make_disturbance()), (0.0, make_disturbance()))
    )
    assert fast > 1.5 * slow
    resting = make_disturbance()
    resting.draw(np.full(3, 0.02), np.zeros(3))
    resting.rest()
    quiet = np.abs(resting.draw(np.zeros(3), np.zeros(3))[0]).max()
    assert quiet < 0.02


def test_a_careful_hand_is_pushed_less():
    careful, careless = (
        np.std([make_disturbance().draw(np.zeros(3), np.zeros(3), care=care)[0] for _ in range(2)])
        for care in (0.1, 1.0)
    )
    np.testing.assert_allclose(careful, 0.1 * careless)


def make_disturbance() -> Disturbance:
    """The first one that does disturb."""
    for seed in range(100):
        disturbance = Disturbance(np.random.default_rng(seed))
        if disturbance.level > 0.0:
            return disturbance
    raise AssertionError("no such seed")
