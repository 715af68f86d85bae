"""Convex quadratic programs of fixed shape, solved by PIQP or, for comparison, by any other."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np
import piqp
import qpsolvers

from common.errors import UnknownName
from common.se3 import Array

PIQP = "piqp"

_EPS_NARROW = 1e-10
_EPS_WIDE = 1e-7


class Shape(NamedTuple):
    """What stays the same from one solve to the next.

    Args:
        size: Number of unknowns.
        rows: Number of rows of G.
        bounds: Whether there are bounds x_l and x_u.
        narrow: For feasible sets that may be as thin as rounding (what a level leaves to the next):
            no test of the duality gap, which has no interior to close in.
    """

    size: int
    rows: int = 0
    bounds: bool = False
    narrow: bool = False


class Program(Protocol):
    """min 1/2 x^T P x + c^T x under x_l <= x <= x_u and h_l <= G x <= h_u."""

    def solve(self, P: Array, c: Array, **constraints: Array) -> Array | None:
        """Solve; None when the tolerances are not reached.

        Args:
            P: (n, n) symmetric, positive definite.
            c: (n,).
            **constraints: `x_l`, `x_u` (n,) and `G` (m, n), `h_l`, `h_u` (m,), as the shape says.
                Single bounds may be infinite, not both of one row.
        """
        ...


class PiqpProgram:
    """PIQP's own interface: one workspace, set up here and updated ever after.

    The last solution leaves traces of 1e-12 in the next one (scaling, regularisation), so an
    episode that is to be repeated bit for bit starts with a new object.

    Args:
        shape: Of the program.
    """

    def __init__(self, shape: Shape) -> None:
        narrow = shape.narrow
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
        solver.setup(**_make_placeholder(shape))

    def solve(self, P: Array, c: Array, **constraints: Array) -> Array | None:
        """Solve; None when PIQP does not reach its tolerances."""
        if "G" in constraints:
            constraints["G"] = np.asfortranarray(constraints["G"])
        # P is symmetric, and its transpose is in PIQP's order already.
        data: dict[str, Any] = {"P": P.T, "c": c, **constraints}
        self._solver.update(**data)
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


ProgramMaker: TypeAlias = Callable[[Shape], Program]


def make_program(solver: str) -> ProgramMaker:
    """What makes programs of a shape with a solver.

    Raises:
        UnknownName: There is no such solver.
    """
    if solver == PIQP:
        return PiqpProgram
    other = OtherProgram(solver)
    return lambda shape: other


def _make_placeholder(shape: Shape) -> dict[str, Any]:
    """Some program of a shape, so that its workspace exists before the first tick."""
    n, m = shape.size, shape.rows
    data: dict[str, Any] = {"P": np.asfortranarray(np.eye(n)), "c": np.zeros(n)}
    if shape.bounds:
        data |= {"x_l": -np.ones(n), "x_u": np.ones(n)}
    if m:
        G = np.asfortranarray(np.ones((m, n)))
        data |= {"G": G, "h_l": -np.ones(m), "h_u": np.ones(m)}
    return data


def _stack_rows(constraints: dict[str, Array], n: int) -> tuple[Array | None, Array | None]:
    """One-sided rows G x <= h (k, n), (k,) of two-sided ones, without infinite ones."""
    if "G" not in constraints:
        return None, None
    G = constraints["G"]
    h = np.concatenate([constraints["h_u"], -constraints["h_l"]])
    finite = np.isfinite(h)
    return np.vstack([G, -G])[finite].reshape(-1, n), h[finite]
