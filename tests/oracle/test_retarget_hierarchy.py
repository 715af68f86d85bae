"""The two levels against reference solvers, and the strictness of their order."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear, minimize

from common.robots import load_robot
from services.retarget.bounds import Box, JointBounds, JointLimits
from services.retarget.hierarchy import Hierarchy
from services.retarget.nullspace import WeightedJacobian
from services.retarget.whole_body import RobotModel

SCALE_M = 1.0


class _State:
    """A random moving state of a robot: Jacobian, wishes (half of them possible) and bounds."""

    def __init__(self, random, J1, limits, q, a_prev):
        n = len(limits)
        self.J1, self.q, self.a_prev = J1, q, a_prev
        self.x2 = random.normal(size=n)
        box = JointBounds(limits, dt_s=0.01).compute(q.tolist(), a_prev.tolist())
        # In full braking both bounds of a joint coincide.
        braking = random.random(n) < random.choice([0.0, 0.3])
        self.box = Box(box.lower, np.where(braking, box.lower, box.upper).tolist())
        if random.random() < 0.5:
            self.x1 = random.normal(size=6) * random.choice([0.05, 0.3, 1.0])
        else:
            self.x1 = J1 @ random.uniform(self.box.lower, self.box.upper)

    def solve(self, x2, *, H=None, W=None):
        n = len(self.q)
        H = np.ones(n) if H is None else H
        W = np.ones(n) if W is None else W
        hierarchy = Hierarchy(H=H, W=W, rotation_scale_m=SCALE_M)
        return hierarchy.solve(self.J1, self.x1, x2, self.a_prev, self.box)


def _panda_states(count, seed=0):
    spec = load_robot("panda")
    model = RobotModel(spec)
    limits = [
        JointLimits(low, high, joint.velocity_limit, joint.acceleration_limit)
        for joint, low, high in zip(spec.joints, model.lower, model.upper, strict=True)
    ]
    random = np.random.default_rng(seed)
    vmax = np.array([limit.velocity for limit in limits])
    for _ in range(count):
        q = random.uniform(model.lower, model.upper)
        near = random.random(7) < 0.2
        q = np.where(near, model.upper - 0.01 * random.random(7), q)
        a_prev = random.uniform(-0.5, 0.5, 7) * vmax
        yield _State(random, model.compute_hand(q)[1], limits, q, a_prev)


def _redundant_states(count, n=12, seed=0):
    random = np.random.default_rng(seed)
    limits = [JointLimits(-2.0, 2.0, 2.0, 12.0)] * n
    for _ in range(count):
        q = random.uniform(-2.0, 2.0, n)
        yield _State(random, random.normal(size=(6, n)) * 0.4, limits, q, random.normal(size=n))


STATES = [*_panda_states(150), *_redundant_states(60), *_redundant_states(30, n=6)]


def test_posture_never_moves_the_hand():
    random = np.random.default_rng(5)
    for state in STATES:
        n = len(state.q)
        one = state.solve(state.x2)
        other = state.solve(10.0 * random.normal(size=n), W=random.uniform(0.1, 20.0, n))
        assert np.abs(state.J1 @ (one.a - other.a)).max() <= 1e-6


def test_solutions_are_in_the_box_and_never_fail():
    for state in STATES:
        solution = state.solve(state.x2)
        assert state.box.contains(solution.a)
        assert all(0.0 <= share <= 1.0 for share in solution.scaling)
        assert solution.failures == 0


def _best_residual(state):
    lower, upper = np.array(state.box.lower), np.array(state.box.upper)
    result = lsq_linear(state.J1, state.x1, (lower, upper + 1e-15), method="bvls", tol=1e-12)
    return np.linalg.norm(state.J1 @ result.x - state.x1)


@pytest.mark.parametrize("states", [list(_panda_states(150, 1)), list(_redundant_states(60, 9, 1))])
def test_hand_is_as_near_as_the_bounds_allow(states):
    saturated = 0
    # Near a singularity both are regularised, differently.
    states = [state for state in states if np.linalg.svd(state.J1)[1][-1] > 0.05]
    for state in states:
        best = _best_residual(state)
        solution = state.solve(state.x2)
        residual = np.linalg.norm(state.J1 @ solution.a - state.x1)
        assert residual - best <= 1e-5 * (1.0 + np.linalg.norm(state.x1))
        saturated += best > 1e-3
        if best < 1e-9:
            assert solution.scaling[0] > 0.999
    # Both branches were tried: within the bounds and at them.
    assert 0 < saturated < len(states)


def test_posture_is_the_best_in_what_the_hand_leaves_free():
    rho = 1e-3
    for state in [*_panda_states(20, 2), *_redundant_states(20, 9, 2)]:
        W = np.linspace(0.5, 2.0, len(state.q))
        solution = state.solve(state.x2, W=W)
        Z = np.linalg.svd(state.J1)[2][6:].T

        def cost(z, a=solution.a, Z=Z, W=W, x2=state.x2):
            moved = a + Z @ z
            return 0.5 * (W * (moved - x2) ** 2).sum() + 0.5 * rho * (moved**2).sum()

        lower, upper = np.array(state.box.lower), np.array(state.box.upper)
        inside = {
            "type": "ineq",
            "fun": lambda z, a=solution.a, Z=Z: np.concatenate(
                [upper - a - Z @ z, a + Z @ z - lower]  # noqa: B023
            ),
        }
        start = np.zeros(Z.shape[1])
        best = minimize(cost, start, constraints=[inside], method="SLSQP", tol=1e-12)
        assert cost(start) <= best.fun + 1e-5 * (1.0 + abs(best.fun))


def test_weights_decide_who_moves():
    # Two joints in one direction, the second is unwilling.
    J1 = np.zeros((6, 7))
    J1[:, :6] = np.eye(6)
    J1[0, 6] = 1.0
    box = Box([-10.0] * 7, [10.0] * 7)
    H = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 4.0])
    # Without a wish of its own, the posture keeps its weight out of it.
    hierarchy = Hierarchy(H=H, W=1e-9 * np.ones(7), rotation_scale_m=1.0)
    x1 = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    a = hierarchy.solve(J1, x1, np.zeros(7), np.zeros(7), box).a
    assert a[[0, 6]] == pytest.approx([0.8, 0.2], abs=1e-6)


def test_half_of_the_way_is_reported_as_half():
    J1 = np.eye(6, 7)
    hierarchy = Hierarchy(H=np.ones(7), W=np.ones(7), rotation_scale_m=1.0)
    box = Box([-0.5] * 7, [0.5] * 7)
    x1 = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    x2 = np.array([0, 0, 0, 0, 0, 0, 2.0])
    solution = hierarchy.solve(J1, x1, x2, np.zeros(7), box)
    assert solution.scaling == pytest.approx((0.5, 0.25), abs=1e-3)


def test_null_space_and_damping():
    random = np.random.default_rng(3)
    J1 = random.normal(size=(6, 9))
    H_root = random.uniform(0.5, 2.0, 9)
    hand = WeightedJacobian(J1, H_root)
    assert np.abs(J1 @ hand.Z).max() < 1e-14
    y = random.normal(size=6)
    assert J1 @ hand.pseudo_inverse(y) == pytest.approx(y, abs=1e-12)
    assert hand.damping == 0.0
    J1[5] = J1[4] + 1e-6 * random.normal(size=9)
    singular = WeightedJacobian(J1, H_root)
    assert singular.damping == pytest.approx(0.02**2, rel=1e-6)
    # Far from what 1 / s would ask for.
    assert np.abs(singular.pseudo_inverse(y)).max() < np.linalg.norm(y) / 0.02 / H_root.min()
