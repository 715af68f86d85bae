"""Invariants that are smooth everywhere: at rest, on straight lines and at reversals.

h_k  = v_k / sqrt(|v_k|^2 + e^2)                  direction, fading out below the length e
m_k  = (sqrt(|v_k|^2 + e^2) - e) / S              length
n_k  = h_k x h_{k+1}
c1_k = h_k . h_{k+1}                              bend, cosine
s1_k = sqrt(|n_k|^2 + e_s^2) - e_s                bend, sine
tc_k = n_k . n_{k+1},  ts_k = h_k . n_{k+1}       torsion, cosine and sine

For unit h, (tc, ts) = |n_k| |n_{k+1}| (cos, sin)(torsion): it fades out where the path is straight
and has no torsion. Nothing is divided by a quantity that can vanish.
"""

from __future__ import annotations

import torch
from torch import Tensor


def compute_smooth_invariants(
    v: Tensor, *, epsilon: float, epsilon_sine: float, scale: float
) -> Tensor:
    """Smooth invariants of a sequence of vectors.

    Args:
        v: (..., n, 3) vectors [m or rad].
        epsilon: e, in the unit of v.
        epsilon_sine: e_s.
        scale: S, in the unit of v.

    Returns:
        (..., F) = [m (n), c1 (n-1), s1 (n-1), tc (n-2), ts (n-2)].
    """
    length = ((v * v).sum(dim=-1) + epsilon * epsilon).sqrt()
    h = v / length[..., None]
    m = (length - epsilon) / scale
    n = torch.linalg.cross(h[..., :-1, :], h[..., 1:, :])
    c1 = (h[..., :-1, :] * h[..., 1:, :]).sum(dim=-1)
    s1 = ((n * n).sum(dim=-1) + epsilon_sine * epsilon_sine).sqrt() - epsilon_sine
    following = n[..., 1:, :]
    tc = (n[..., :-1, :] * following).sum(dim=-1)
    ts = (h[..., : following.shape[-2], :] * following).sum(dim=-1)
    return torch.cat([m, c1, s1, tc, ts], dim=-1)
