"""The few LAPACK routines of the hot path, typed. At this size numpy's own take twice as long."""

from __future__ import annotations

from scipy.linalg.lapack import dgesdd, dposv, dpotrf  # pyright: ignore[reportAttributeAccessIssue]

from common.se3 import Array


def solve_positive(G: Array, rhs: Array) -> Array | None:
    """X with G x = rhs for a symmetric positive definite G (m, m); None when it is not.

    Args:
        G: (m, m).
        rhs: (m,) or (m, k).
    """
    _, x, info = dposv(G, rhs)
    return None if info else x


def is_positive(G: Array) -> bool:
    """Whether a symmetric G (m, m) is positive definite."""
    return dpotrf(G)[1] == 0


def smallest_pivot(G: Array) -> float:
    """Least diagonal entry of the Cholesky factor of G (m, m); 0 when there is no factor."""
    factor, info = dpotrf(G)
    return 0.0 if info else float(factor.diagonal().min())


def decompose(A: Array) -> tuple[Array, Array, Array]:
    """Full singular value decomposition A = U diag(S) V^T: U (m, m), S (min(m, n),), V^T (n, n)."""
    U, S, Vt, _ = dgesdd(A)
    return U, S, Vt
