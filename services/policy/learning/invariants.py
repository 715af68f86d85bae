"""Motion invariants of a sequence of differential poses, after DHB (Lee et al. 2018).

Deltas u_k = (dp_k, r_k), k = 0..n-1, each in the frame before it, give two sequences of vectors

    A_0 = I;  v_k = A_k dp_k;  A_{k+1} = A_k exp(r_k)    steps, all in the frame of the start
    w_k = r_k                                            turns, each in the frame of the body

and both are described by lengths, bends and torsions: phi = [phi(v), phi(w)]. A rotation or
translation of the world does not change the deltas at all; a constant rotation of the tool frame
turns all v and w together. A constant lever arm changes v, not w.

Source: the paper's appendix. Its difference of two rotation vectors r_{k+1} - r_k is invariant to
first order only, so w is the turn itself.
"""

from __future__ import annotations

from itertools import accumulate

import torch
from torch import Tensor

from services.policy.learning.config import InvariantForm, PaperForm
from services.policy.learning.invariants_paper import compute_paper_invariants
from services.policy.learning.invariants_smooth import compute_smooth_invariants
from services.policy.learning.normalization import MotionScale
from services.policy.learning.rotations import compose, exp3, rotate


def compute_motion_vectors(deltas: Tensor) -> tuple[Tensor, Tensor]:
    """Steps v and turns w of deltas.

    Args:
        deltas: (..., n, 6) translation [m] and rotation vector [rad].

    Returns:
        v (..., n, 3) [m] in the start frame and w (..., n, 3) [rad] in the body frame.
    """
    translations, turns = deltas[..., :3], deltas[..., 3:]
    steps = [translations[..., 0, :]]
    # Where the last turn leads to is not asked for.
    R_next = exp3(turns[..., :-1, :]).unbind(dim=-3)
    for k, A in enumerate(accumulate(R_next, compose), start=1):
        steps.append(rotate(A, translations[..., k, :]))
    return torch.stack(steps, dim=-2), turns


def compute_invariants(deltas: Tensor, *, form: InvariantForm, scale: MotionScale) -> Tensor:
    """Phi of deltas, in float32 or better; the paper's form in float64.

    Args:
        deltas: (..., n, 6) translation [m] and rotation vector [rad], n >= 1.
        form: Which invariants, with their constants.
        scale: Typical lengths of the data set, the units of the smooth form.

    Returns:
        (..., F) invariants, those of v before those of w.
    """
    if isinstance(form, PaperForm):
        v, w = compute_motion_vectors(deltas.double())
        return torch.cat([compute_paper_invariants(x, full=form.full) for x in (v, w)], dim=-1)
    v, w = compute_motion_vectors(deltas.to(torch.promote_types(deltas.dtype, torch.float32)))
    e_s = form.epsilon_sine
    linear = compute_smooth_invariants(
        v, epsilon=form.epsilon_m, epsilon_sine=e_s, scale=scale.step_m
    )
    angular = compute_smooth_invariants(
        w, epsilon=form.epsilon_rad, epsilon_sine=e_s, scale=scale.turn_rad
    )
    return torch.cat([linear, angular], dim=-1)
