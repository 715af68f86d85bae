"""Where the hand will be: against poses composed one by one."""

import numpy as np

from common.se3 import apply_differential, differential, make_pose, pose_from_wire, pose_to_wire
from services.policy.training.future import look_ahead

SPANS = np.array([[0, 12], [12, 9]])


def walk(seed: int) -> np.ndarray:
    """Measured poses of both episodes, each a random walk."""
    random = np.random.default_rng(seed)
    rows: list[list[float]] = []
    for _, length in SPANS.tolist():
        T = make_pose(np.eye(3), random.normal(size=3))
        for _ in range(length):
            rows.append(pose_to_wire(T))
            T = apply_differential(T, random.normal(0, 0.01, 3), random.normal(0, 0.05, 3))
    return np.array(rows, np.float32)


def test_it_is_the_way_to_a_later_pose_of_the_same_episode():
    poses, horizons = walk(0), (1, 4)
    expected = np.zeros((len(poses), 2, 6))
    for start, length in SPANS.tolist():
        for row in range(start, start + length):
            for number, horizon in enumerate(horizons):
                later = min(row + horizon, start + length - 1)
                ends = [pose_from_wire(poses[each].tolist()) for each in (row, later)]
                expected[row, number] = np.concatenate(differential(*ends))
    spread = np.sqrt(np.mean(expected**2, axis=0))
    expected = np.clip(expected / spread, -4, 4)
    np.testing.assert_allclose(look_ahead(poses, SPANS, horizons), expected, atol=2e-4)


def test_at_the_end_of_an_episode_the_hand_stays():
    ahead = look_ahead(walk(1), SPANS, (3,))
    assert not ahead[11].any()
    assert not ahead[20].any()
    assert ahead[10].any()


def test_a_hand_that_never_moves_is_no_division_by_zero():
    poses = np.repeat(walk(2)[:1], 21, axis=0)
    assert not look_ahead(poses, SPANS, (1, 5)).any()
