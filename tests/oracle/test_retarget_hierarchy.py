"""The levels against reference solvers, and the strictness of their order, on every robot."""

import numpy as np
import pytest
from scipy.optimize import linprog, lsq_linear, minimize

from services.retarget.bounds import Box, JointBounds
from services.retarget.hierarchy import Hierarchy
from services.retarget.level import Level, LevelShape
from services.retarget.nullspace import DAMPED_BELOW, WeightedJacobian, is_regular
from services.retarget.rows import Approach, gather_rows
from services.retarget.whole_body import list_limits
from tests.retarget_runs import BODIES, robot_model

ONES = np.ones(6)


class _State:
    """A random moving state of a robot: levels, wishes (half of them possible) and bounds."""

    def __init__(self, random, name):
        model = robot_model(name)
        self.model, self.n = model, model.pin.nv
        limits = list_limits(model)
        vmax = np.array([limit.velocity for limit in limits])
        lower, upper = np.maximum(model.lower, -3.0), np.minimum(model.upper, 3.0)
        q = random.uniform(lower, upper)
        near = random.random(self.n) < 0.2
        q = np.where(near, upper - 0.01 * random.random(self.n), q)
        self.a_prev = random.uniform(-0.5, 0.5, self.n) * vmax
        box = JointBounds(limits, dt_s=0.01).compute(q, self.a_prev)
        # In full braking both bounds of a joint coincide.
        braking = random.random(self.n) < random.choice([0.0, 0.3])
        self.box = Box(box.lower, np.where(braking, box.lower, box.upper))
        self.J = model.compute_hand(q)[1]
        possible = random.random() < 0.5
        self.x1 = (
            self.J @ random.uniform(*self.box)
            if possible
            else random.normal(size=6) * random.choice([0.05, 0.3, 1.0])
        )
        self.levels = [Level(self.J, self.x1, ONES)]
        self.shapes = [LevelShape(6, model.hand_joints)]
        if model.spec.head is not None:
            frame = model.find_site(model.spec.head.site)
            model.update(q)
            J_head = model.compute_site(frame)[1][3:]
            x_head = random.normal(size=3) * 0.3
            self.levels.append(Level(J_head, x_head, np.ones(3)))
            self.shapes.append(LevelShape(3, model.list_moving(frame)))
        self.x2 = random.normal(size=self.n)
        self.rows = None

    def add_rows(self, random, count=3):
        """Walls that the hand and other points may approach slowly."""
        directions = random.normal(size=(count, 6))
        directions[:, 3:] *= 0.1
        self.rows = gather_rows(
            [Approach(d @ self.J, 0.1, random.uniform(-0.02, 0.05), "wall") for d in directions],
            self.n,
        )

    def solve(self, x2, *, H=None, W=None, mode="project", solver="piqp"):
        H = np.ones(self.n) if H is None else H
        W = np.ones(self.n) if W is None else W
        hierarchy = Hierarchy(H=H, W=W, shapes=self.shapes, mode=mode, solver=solver)
        return hierarchy.solve(self.levels, x2, self.box, self.rows)

    @property
    def is_regular(self):
        # Near a singularity the hand is damped on purpose.
        return np.linalg.svd(self.J)[1][-1] > 2.0 * DAMPED_BELOW


def test_the_cheap_test_of_singularity_agrees_with_the_decomposition():
    random = np.random.default_rng(5)
    answers: list[bool] = []
    for _ in range(200):
        U, _, Vt = np.linalg.svd(random.normal(size=(6, 9)))
        # Half of them a hair's breadth beside the threshold.
        least = DAMPED_BELOW * random.choice([0.0, 0.5, 1.0 - 1e-6, 1.0 + 1e-6, 2.0])
        S = np.array([*random.uniform(0.3, 2.0, 5), least])
        H_root = random.uniform(0.5, 2.0, 9)
        TJ = (U * S) @ Vt[:6] * H_root
        answers.append(is_regular(TJ, H_root))
        assert answers[-1] == (WeightedJacobian(TJ, H_root).damping == 0.0)
    assert 50 < sum(answers) < 150


def _states(name, count, seed=0, *, rows=False):
    random = np.random.default_rng([seed, len(name)])
    states = [_State(random, name) for _ in range(count)]
    if rows:
        for state in states:
            state.add_rows(random)
    return states


@pytest.mark.parametrize("mode", ["project", "scale"])
@pytest.mark.parametrize("rows", [False, True])
@pytest.mark.parametrize("name", BODIES)
def test_posture_never_moves_what_is_above_it(name, rows, mode):
    random = np.random.default_rng(5)
    for state in _states(name, 60, rows=rows):
        one = state.solve(state.x2, mode=mode)
        W = random.uniform(0.1, 20.0, state.n)
        other = state.solve(10.0 * random.normal(size=state.n), W=W, mode=mode)
        assert np.abs(state.J @ (one.a - other.a)).max() <= 1e-6


@pytest.mark.parametrize("name", BODIES)
def test_head_never_moves_the_hand(name):
    for state in _states(name, 40, 3):
        one = state.solve(state.x2)
        state.levels, state.shapes = state.levels[:1], state.shapes[:1]
        alone = state.solve(state.x2)
        assert np.abs(state.J @ (one.a - alone.a)).max() <= 1e-6


@pytest.mark.parametrize("mode", ["project", "scale"])
@pytest.mark.parametrize("name", BODIES)
def test_solutions_are_in_the_box_and_never_fail(name, mode):
    for rows in (False, True):
        for state in _states(name, 60, 4, rows=rows):
            solution = state.solve(state.x2, mode=mode)
            assert state.box.contains(solution.a)
            assert all(0.0 <= share <= 1.0 for share in solution.scaling)
            assert len(solution.scaling) == len(state.levels) + 1
            assert solution.failures == 0


def _best_residual(state):
    lower, upper = state.box
    result = lsq_linear(state.J, state.x1, (lower, upper + 1e-15), method="bvls", tol=1e-12)
    return np.linalg.norm(state.J @ result.x - state.x1)


@pytest.mark.parametrize("name", BODIES)
def test_hand_is_as_near_as_the_bounds_allow(name):
    states = [state for state in _states(name, 150, 1) if state.is_regular]
    saturated = 0
    for state in states:
        best = _best_residual(state)
        solution = state.solve(state.x2)
        residual = np.linalg.norm(state.J @ solution.a - state.x1)
        assert residual - best <= 1e-5 * (1.0 + np.linalg.norm(state.x1))
        saturated += best > 1e-3
        if best < 1e-9:
            assert solution.scaling[0] > 0.999
    # Both kinds were tried: within the bounds and at them.
    assert 0 < saturated < len(states)


@pytest.mark.parametrize("rows", [False, True])
@pytest.mark.parametrize("name", BODIES)
def test_scaling_factor_is_that_of_the_linear_program(name, rows):
    states = [state for state in _states(name, 60, 2, rows=rows) if state.is_regular]
    assert len(states) > 10
    below_one = 0
    for state in states:
        anchor = state.box.clip(np.zeros(state.n))
        if state.rows is not None and not state.rows.allow(anchor):
            continue
        lower, upper = state.box
        # J a = J a0 + c (x1 - J a0), unknowns (c, a).
        J0 = state.J @ anchor
        A_eq = np.column_stack([-(state.x1 - J0), state.J])
        C, U = (None, None)
        if state.rows is not None:
            n_rows = len(state.rows.names)
            C = np.column_stack([np.zeros(n_rows), state.rows.C[:n_rows]])
            U = state.rows.U[:n_rows]
        cost = np.r_[-1.0, np.zeros(state.n)]
        bounds = [(0.0, 1.0), *zip(lower, upper, strict=True)]
        best = linprog(cost, A_ub=C, b_ub=U, A_eq=A_eq, b_eq=J0, bounds=bounds, method="highs")
        assert best.status == 0
        c = state.solve(state.x2, mode="scale").scaling[0]
        assert c == pytest.approx(-best.fun, abs=1e-6)
        below_one += c < 0.999
    assert below_one > 0


@pytest.mark.parametrize("name", BODIES)
def test_project_gets_further_than_scale(name):
    for state in _states(name, 40, 6):
        if not state.is_regular or not state.box.contains(np.zeros(state.n)):
            continue
        c_project = state.solve(state.x2).scaling[0]
        c_scale = state.solve(state.x2, mode="scale").scaling[0]
        assert c_project >= c_scale - 1e-3


@pytest.mark.parametrize("name", BODIES)
def test_rows_are_kept_or_violated_least(name):
    relaxed = 0
    for state in _states(name, 60, 7, rows=True):
        rows, (lower, upper) = state.rows, state.box
        solution = state.solve(state.x2)
        kept = len(rows.names)
        C, U = rows.C[:kept], rows.U[:kept]
        violation = np.maximum(C @ solution.a - U, 0.0)
        least = minimize(
            lambda a, C=C, U=U: 0.5 * (np.maximum(C @ a - U, 0.0) ** 2).sum(),
            solution.a,
            jac=lambda a, C=C, U=U: C.T @ np.maximum(C @ a - U, 0.0),
            bounds=list(zip(lower, upper + 1e-12, strict=True)),
            method="L-BFGS-B",
            options={"ftol": 1e-15, "gtol": 1e-12},
        )
        assert violation @ violation <= 2.0 * least.fun * (1.0 + 1e-5) + 1e-6
        relaxed += least.fun > 1e-6
    assert relaxed > 0


@pytest.mark.parametrize("name", ["panda", "spot"])
def test_posture_is_the_best_in_what_the_hand_leaves_free(name):
    rho = 1e-3
    for state in _states(name, 15, 2):
        if not state.is_regular:
            continue
        W = np.linspace(0.5, 2.0, state.n)
        solution = state.solve(state.x2, W=W)
        Z = np.linalg.svd(state.J)[2][6:].T

        def cost(z, a=solution.a, Z=Z, W=W, x2=state.x2):
            moved = a + Z @ z
            return 0.5 * (W * (moved - x2) ** 2).sum() + 0.5 * rho * (moved**2).sum()

        lower, upper = state.box
        inside = {
            "type": "ineq",
            "fun": lambda z, a=solution.a, Z=Z, lower=lower, upper=upper: np.concatenate(
                [upper - a - Z @ z, a + Z @ z - lower]
            ),
        }
        start = np.zeros(Z.shape[1])
        best = minimize(cost, start, constraints=[inside], method="SLSQP", tol=1e-12)
        assert cost(start) <= best.fun + 1e-5 * (1.0 + abs(best.fun))


@pytest.mark.parametrize("name", BODIES)
def test_another_solver_by_name_agrees(name):
    compared = 0
    for rows in (False, True):
        for state in _states(name, 15, 8, rows=rows):
            one = state.solve(state.x2)
            other = state.solve(state.x2, solver="daqp")
            if other.failures == 0:
                assert state.J @ other.a == pytest.approx(state.J @ one.a, abs=1e-3)
                compared += 1
    assert compared > 20


def test_weights_decide_who_moves():
    # Two joints in one direction, the second is unwilling.
    J1 = np.zeros((6, 7))
    J1[:, :6] = np.eye(6)
    J1[0, 6] = 1.0
    box = Box(np.full(7, -10.0), np.full(7, 10.0))
    H = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 4.0])
    # Without a wish of its own, the posture keeps its weight out of it.
    hierarchy = Hierarchy(H=H, W=1e-9 * np.ones(7), shapes=[LevelShape(6, np.ones(7, dtype=bool))])
    x1 = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    level = Level(J1, x1, ONES)
    a = hierarchy.solve([level], np.zeros(7), box, None).a
    assert a[[0, 6]] == pytest.approx([0.8, 0.2], abs=1e-6)


def test_half_of_the_way_is_reported_as_half():
    moves = np.array([True] * 6 + [False])
    hierarchy = Hierarchy(H=np.ones(7), W=np.ones(7), shapes=[LevelShape(6, moves)])
    box = Box(np.full(7, -0.5), np.full(7, 0.5))
    x1 = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    x2 = np.array([0, 0, 0, 0, 0, 0, 2.0])
    solution = hierarchy.solve([Level(np.eye(6, 7), x1, ONES)], x2, box, None)
    assert solution.scaling == pytest.approx([0.5, 0.25], abs=1e-3)
    assert solution.a == pytest.approx([0.5, 0, 0, 0, 0, 0, 0.5], abs=1e-6)


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
    assert singular.damping == pytest.approx(DAMPED_BELOW**2, rel=1e-6)
    # Far from what 1 / s would ask for.
    most = np.linalg.norm(y) / DAMPED_BELOW / H_root.min()
    assert np.abs(singular.pseudo_inverse(y)).max() < most
