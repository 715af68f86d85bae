"""Convex quadratic programs of fixed shape, solved by PIQP."""

from __future__ import annotations

from typing import Any

import numpy as np
import piqp

from common.se3 import Array


class ConvexProgram:
    """min 1/2 x^T P x + c^T x under bounds and rows, one `setup` and then updates.

    The last solution leaves traces of 1e-12 in the next one (scaling, regularisation), so an
    episode that is to be repeated bit for bit starts with a new object.

    Args:
        narrow: For feasible sets that may be as thin as rounding (what level 1 leaves to level 2):
            looser tolerances and no test of the duality gap, which has no interior to converge in.
    """

    def __init__(self, *, narrow: bool) -> None:
        solver = piqp.DenseSolver()
        settings = solver.settings
        settings.eps_abs = 1e-8 if narrow else 1e-9
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
        self._is_set_up = False

    def solve(self, P: Array, c: Array, **constraints: Array) -> Array | None:
        """Solve; None when PIQP does not reach its tolerances.

        Args:
            P: (n, n) symmetric, positive definite.
            c: (n,).
            **constraints: `x_l`, `x_u` (n,) bounds; `G` (m, n), `h_l`, `h_u` (m,) rows. The same
                ones in every call.
        """
        if "G" in constraints:
            constraints["G"] = np.asfortranarray(constraints["G"])
        data: dict[str, Any] = {"P": np.asfortranarray(P), "c": c, **constraints}
        if self._is_set_up:
            self._solver.update(**data)
        else:
            self._solver.setup(**data)
            self._is_set_up = True
        if self._solver.solve() != piqp.PIQP_SOLVED:
            return None
        return np.array(self._solver.result.x)
