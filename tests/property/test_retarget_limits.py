"""The whole retargeter under wild targets: no limit is ever passed, nothing ever fails."""

import numpy as np
import pytest

from common.robots import load_robot
from services.retarget.whole_body import RobotModel
from tests.retarget_runs import jumping_references, make_panda

TICKS = 1250


@pytest.mark.parametrize("seed", range(4))
def test_jumping_targets_never_pass_a_limit(seed):
    spec = load_robot("panda")
    model = RobotModel(spec)
    vmax = np.array([joint.velocity_limit for joint in spec.joints])
    change = 0.01 * np.array([joint.acceleration_limit for joint in spec.joints])
    retargeter = make_panda()
    random = np.random.default_rng(seed)
    last_q, last_a = np.array(spec.start_positions), np.zeros(7)
    limited, q_most, q_least = 0, last_q, last_q
    for reference in jumping_references(random, TICKS):
        motion = retargeter.follow(reference)
        q, a = np.array(motion.positions), np.array(motion.velocities)
        assert np.isfinite(q).all()
        assert (q <= model.upper + 1e-12).all()
        assert (q >= model.lower - 1e-12).all()
        assert (np.abs(a) <= vmax + 1e-9).all()
        assert (np.abs(a - last_a) <= change * (1.0 + 1e-6)).all()
        assert np.array_equal(q, last_q + 0.01 * a)
        last_q, last_a = q, a
        q_most, q_least = np.maximum(q_most, q), np.minimum(q_least, q)
        limited += bool(motion.active_limits)
        assert motion.failures == 0
    # The targets did push the joints to their limits.
    assert limited > TICKS / 2
    assert (q_most > model.upper - 0.01).any() or (q_least < model.lower + 0.01).any()
