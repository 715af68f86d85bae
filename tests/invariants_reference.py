"""The motion invariants in plain NumPy, one trajectory at a time, as the formulas are written.

Nothing here is made safe: it is the reference where every quotient is well defined.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from common.se3 import differential

Array = npt.NDArray[np.float64]


def steps_and_turns(deltas: Array) -> tuple[Array, Array]:
    """v in the frame of the start and w in the frame of the body, of deltas (n, 6)."""
    orientation = Rotation.identity()
    v = []
    for delta in deltas:
        v.append(orientation.apply(delta[:3]))
        orientation = orientation * Rotation.from_rotvec(delta[3:])
    return np.array(v), deltas[:, 3:].copy()


def smooth(v: Array, *, e: float, e_s: float, S: float) -> Array:
    """[m, c1, s1, tc, ts] of vectors (n, 3)."""
    count = len(v)
    root = [np.sqrt(x @ x + e**2) for x in v]
    h = [x / r for x, r in zip(v, root, strict=True)]
    n = [np.cross(h[k], h[k + 1]) for k in range(count - 1)]
    m = [(r - e) / S for r in root]
    c1 = [h[k] @ h[k + 1] for k in range(count - 1)]
    s1 = [np.sqrt(x @ x + e_s**2) - e_s for x in n]
    tc = [n[k] @ n[k + 1] for k in range(count - 2)]
    ts = [h[k] @ n[k + 1] for k in range(count - 2)]
    return np.array([*m, *c1, *s1, *tc, *ts])


def angles(v: Array) -> tuple[Array, Array, Array]:
    """m (n), th1 (n-1) and th2 (n-2) of vectors (n, 3) that never rest nor go straight."""
    m = np.linalg.norm(v, axis=1)
    x = v / m[:, None]
    bends = np.cross(x[:-1], x[1:])
    y = bends / np.linalg.norm(bends, axis=1)[:, None]
    th1 = [np.arctan2(np.cross(x[k], x[k + 1]) @ y[k], x[k] @ x[k + 1]) for k in range(len(y))]
    th2 = [
        np.arctan2(np.cross(y[k], y[k + 1]) @ x[k + 1], y[k] @ y[k + 1]) for k in range(len(y) - 1)
    ]
    return m, np.array(th1), np.array(th2)


def paper(v: Array, *, full: bool) -> Array:
    """[m, sin th1, sin 2 th1, sin th2, sin 2 th2] of vectors (n, 3)."""
    m, th1, th2 = angles(v)
    if not full:
        m, th1 = m[: len(th2)], th1[: len(th2)]
    return np.concatenate([m, np.sin(th1), np.sin(2 * th1), np.sin(th2), np.sin(2 * th2)])


def rebuild(m: Array, th1: Array, th2: Array, *, x: Array, y: Array) -> Array:
    """Vectors (n, 3) of their invariants and the first two axes."""
    vectors = [m[0] * x]
    for k in range(len(th1)):
        x = Rotation.from_rotvec(th1[k] * y).apply(x)
        vectors.append(m[k + 1] * x)
        if k < len(th2):
            y = Rotation.from_rotvec(th2[k] * x).apply(y)
    return np.array(vectors)


def random_deltas(count: int, *, seed: int = 0) -> Array:
    """(count, 6) steps of about 1 cm and 0.03 rad, as at 10 Hz."""
    random = np.random.default_rng(seed)
    return random.normal(size=(count, 6)) * [0.01, 0.01, 0.01, 0.03, 0.03, 0.03]


def deltas_of(poses: list[Array]) -> Array:
    """(n, 6) deltas of n + 1 poses (4, 4)."""
    return np.array([np.concatenate(differential(a, b)) for a, b in pairwise(poses)])
