"""The paper's invariants, with every quotient that can be 0/0 repaired.

m_k = |v_k|,  x_k = v_k / m_k,  c_k = x_k x x_{k+1},  y_k = c_k / |c_k|
sin th1_k = c_k . y_k,                    cos th1_k = x_k . x_{k+1}
sin th2_k = (y_k x y_{k+1}) . x_{k+1},    cos th2_k = y_k . y_{k+1}
phi = [m, sin th1, sin 2 th1, sin th2, sin 2 th2],  sin 2 th = 2 sin th cos th

There is no arctangent: it has no gradient at (0, 0) and its quotient in the paper loses the
quadrant. Where v_k or c_k vanishes the previous axis is carried on; before the first motion or bend
there is no axis, and the zero vector stands for it: it is perpendicular to everything and gives the
same angles (sine 0) as any constant axis would.

Known weaknesses, kept because this form is for comparison: straight motion and its reversal look
alike, and the gradient of y grows as 1/|c| on nearly straight motion, so clip gradients.

Source: the paper's appendix.
"""

from __future__ import annotations

import torch
from torch import Tensor

_REST = 1e-6
"""A vector shorter than this [m or rad] has no direction."""
_STRAIGHT = 1e-6
"""A bend whose sine is smaller has no plane. Above the rounding of float32 inputs."""


def compute_paper_invariants(v: Tensor, *, full: bool) -> Tensor:
    """The paper's invariants of a sequence of vectors.

    Args:
        v: (..., n, 3) float64 vectors [m or rad].
        full: All n lengths and n-1 bends. Otherwise the paper's index range k < n-2, in which the
            last vector only acts through the last torsion.

    Returns:
        (..., F) = [m, sin th1, sin 2 th1, sin th2, sin 2 th2]: n + 2 (n-1) + 2 (n-2) values if
        full, else 5 (n-2).
    """
    m, raw_x = _normalise(v, _REST)
    x = _carry(raw_x, m > 0.0)
    before, after = x[..., :-1, :], x[..., 1:, :]
    c = torch.linalg.cross(before, after)
    sine, raw_y = _normalise(c, _STRAIGHT)
    y = _carry(raw_y, sine > 0.0)
    sin1, cos1 = _dot(c, y), _dot(before, after)
    turn = torch.linalg.cross(y[..., :-1, :], y[..., 1:, :])
    sin2 = _dot(turn, x[..., 1 : 1 + turn.shape[-2], :])
    cos2 = _dot(y[..., :-1, :], y[..., 1:, :])
    if not full:
        count = sin2.shape[-1]
        m, sin1, cos1 = m[..., :count], sin1[..., :count], cos1[..., :count]
    return torch.cat([m, sin1, 2.0 * sin1 * cos1, sin2, 2.0 * sin2 * cos2], dim=-1)


def _normalise(v: Tensor, smallest: float) -> tuple[Tensor, Tensor]:
    """Length and direction of vectors; both zero below the smallest length."""
    square = _dot(v, v)
    valid = square > smallest * smallest
    # Made safe before the root: the branch not taken must not turn its zero gradient into NaN.
    length = torch.where(valid, square, 1.0).sqrt()
    direction = torch.where(valid[..., None], v / length[..., None], 0.0)
    return torch.where(valid, length, 0.0), direction


def _carry(axes: Tensor, valid: Tensor) -> Tensor:
    """Replace axes (..., n, 3) that are not valid (..., n) by the last one that is."""
    if axes.shape[-2] == 0:
        return axes
    carried = [axes[..., 0, :]]
    for k in range(1, axes.shape[-2]):
        carried.append(torch.where(valid[..., k, None], axes[..., k, :], carried[-1]))
    return torch.stack(carried, dim=-2)


def _dot(a: Tensor, b: Tensor) -> Tensor:
    return (a * b).sum(dim=-1)
