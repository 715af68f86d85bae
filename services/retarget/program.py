"""Convex quadratic programs of fixed shape, solved by PIQP or, for comparison, by any other."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
import piqp
import qpsolvers

from common.errors import UnknownName
from common.se3 import Array

PIQP = "piqp"

_EPS_NARROW = 1e-10
_EPS_WIDE = 1e-7


class Program(Protocol):
    """min 1/2 x^T P x + c^T x under bounds and rows."""

    def solve(self, P: Array, c: Array, **constraints: Array) -> Array | None:
        """Solve; None when the tolerances are not reached.

        Args:
            P: (n, n) symmetric, positive definite.
            c: (n,).
            **constraints: `x_l`, `x_u` (n,) bounds; `G` (m, n), `h_l`, `h_u` (m,) rows. The same
                ones in every call; what is absent in `h_l` or `h_u` is infinite.
        """
        ...


class PiqpProgram:
    """PIQP's own interface: one `setup`, then updates of the same workspace.

    The last solution leaves traces of 1e-12 in the next one (scaling, regularisation), so an
    episode that is to be repeated bit for bit starts with a new object.

    Args:
        narrow: For feasible sets that may be as thin as rounding (what level 1 leaves to level 2):
            no test of the duality gap, which has no interior to close in.
    """

    def __init__(self, *, narrow: bool) -> None:
        solver = piqp.DenseSolver()
        settings = solver.settings
        settings.eps_abs = _EPS_NARROW if narrow else 1e-9
        settings.eps_rel = 0.0 if narrow else 1e-9
        settings.check_duality_gap = not narrow
        settings.eps_duality_gap_abs = settings.eps_duality_gap_rel = 1e-9
        # Every program here has a solution. The default of 1e-4 calls 1 in 1000 infeasible when
        # bounds coincide, as they do in full braking.
        settings.eps_primal_inf = settings.eps_dual_inf = 1e-12
        settings.max_iter = 100
        settings.preconditioner_iter = 10
        settings.reg_lower_limit = settings.reg_finetune_lower_limit = 1e-13
        self._solver = solver
        self._narrow = narrow
        self._is_set_up = False

    def solve(self, P: Array, c: Array, **constraints: Array) -> Array | None:
        """Solve; None when PIQP does not reach its tolerances."""
        if "G" in constraints:
            constraints["G"] = np.asfortranarray(constraints["G"])
        # P is symmetric, and its transpose is in PIQP's order already.
        data: dict[str, Any] = {"P": P.T, "c": c, **constraints}
        if self._is_set_up:
            self._solver.update(**data)
        else:
            self._solver.setup(**data)
            self._is_set_up = True
        status = self._solver.solve()
        if status != piqp.PIQP_SOLVED and self._narrow:
            # Sets thinner than this tolerance are solved to a wider one.
            self._solver.settings.eps_abs = _EPS_WIDE
            status = self._solver.solve()
            self._solver.settings.eps_abs = _EPS_NARROW
        return np.array(self._solver.result.x) if status == piqp.PIQP_SOLVED else None


class OtherProgram:
    """Any solver that qpsolvers knows, by name. Slower; for comparison and as an oracle.

    Args:
        solver: A name of `qpsolvers.available_solvers`.

    Raises:
        UnknownName: It is not installed.
    """

    def __init__(self, solver: str) -> None:
        if solver not in qpsolvers.available_solvers:
            raise UnknownName("QP solver", solver, [PIQP, *qpsolvers.available_solvers])
        self._name = solver

    def solve(self, P: Array, c: Array, **constraints: Array) -> Array | None:
        """Solve; None when the solver finds nothing."""
        G, h = _stack_rows(constraints, len(c))
        lower, upper = constraints.get("x_l"), constraints.get("x_u")
        try:
            return qpsolvers.solve_qp(P, c, G, h, lb=lower, ub=upper, solver=self._name)
        except qpsolvers.SolverError:
            return None


def make_program(solver: str) -> Callable[[bool], Program]:
    """What makes programs with a solver, asked whether their feasible sets are narrow.

    Raises:
        UnknownName: There is no such solver.
    """
    if solver == PIQP:
        return lambda narrow: PiqpProgram(narrow=narrow)
    OtherProgram(solver)
    return lambda narrow: OtherProgram(solver)


def _stack_rows(constraints: dict[str, Array], n: int) -> tuple[Array | None, Array | None]:
    """One-sided rows G x <= h (k, n), (k,) of two-sided ones, without infinite ones."""
    if "G" not in constraints:
        return None, None
    G = constraints["G"]
    nothing = np.full(len(G), np.inf)
    h = np.concatenate([constraints.get("h_u", nothing), -constraints.get("h_l", -nothing)])
    finite = np.isfinite(h)
    return np.vstack([G, -G])[finite].reshape(-1, n), h[finite]
