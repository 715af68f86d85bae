"""Every robot under wild targets: no limit is ever passed, nothing ever fails."""

import numpy as np
import pytest

from common.tasks import load_task
from services.retarget.whole_body import WholeBodyRetargeter, list_limits
from tests.retarget_runs import BODIES, jumping_references, robot_model

SHORT, LONG = 800, 5000
OBSTACLES = load_task("lid").obstacles


class _Watch:
    """Checks each tick of a run against the robot's limits."""

    def __init__(self, model, q):
        limits = list_limits(model)
        self.model, self.q, self.a = model, np.array(q), np.zeros(len(q))
        self.vmax = np.array([limit.velocity for limit in limits])
        self.change = 0.01 * np.array([limit.acceleration for limit in limits])
        self.span = model.upper - model.lower
        # Outside at the start, a joint may not go further out than it has to.
        self.over = np.maximum(np.maximum(self.q - model.upper, model.lower - self.q), 0.0)
        self.limited, self.touched = 0, np.zeros(len(q), dtype=bool)

    def restart(self, q):
        """Go on from another start."""
        other = _Watch(self.model, q)
        other.limited, other.touched = self.limited, self.touched
        return other

    def check(self, motion):
        q, a = np.array(motion.positions), np.array(motion.velocities)
        assert np.isfinite(q).all()
        over = np.maximum(np.maximum(q - self.model.upper, self.model.lower - q), 0.0)
        assert (over <= self.over + 1e-12).all()
        assert (np.abs(a) <= self.vmax + 1e-9).all()
        assert (np.abs(a - self.a) <= self.change * (1.0 + 1e-6)).all()
        assert np.array_equal(q, self.q + 0.01 * a)
        self.touched |= (q > self.model.upper - 0.01) | (q < self.model.lower + 0.01)
        self.limited += bool(motion.active_limits)
        self.q, self.a, self.over = q, a, over


@pytest.mark.long
@pytest.mark.parametrize("mode", ["project", "scale"])
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("name", BODIES)
def test_twenty_thousand_ticks_per_robot(name, seed, mode):
    _fuzz(name, seed + 10, mode, LONG)


@pytest.mark.parametrize("mode", ["project", "scale"])
@pytest.mark.parametrize("name", BODIES)
def test_jumping_targets_never_pass_a_limit(name, mode):
    _fuzz(name, 0, mode, SHORT)


def _fuzz(name, seed, mode, ticks):
    model = robot_model(name, mode)
    random = np.random.default_rng(seed)
    retargeter = WholeBodyRetargeter(model, OBSTACLES)
    q = [joint.start for joint in model.spec.joints]
    watch, failures = _Watch(model, q), 0
    for tick, reference in enumerate(jumping_references(random, ticks)):
        if tick % 400 == 0 and tick:
            # Anywhere in the range, at its ends, and a little beyond them.
            span = np.maximum(np.minimum(model.upper, 3.0), model.lower)
            q = random.uniform(model.lower, span)
            at = random.random(len(q))
            q = np.where(at < 0.2, model.upper, np.where(at < 0.4, model.lower, q))
            q = np.where(at > 0.9, model.upper + 0.05, q)
            retargeter.start(q.tolist())
            watch = watch.restart(q)
        motion = retargeter.follow(reference)
        watch.check(motion)
        failures += motion.failures
    # A level may fall back where bounds and rows leave it no room at all; never more often.
    assert failures <= ticks // 1000
    # The targets did push the joints to their limits.
    assert watch.limited > 200
    assert watch.touched.any()
