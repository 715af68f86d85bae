"""A tree of boxes around triangles, so that a ray looks at few of them.

The tree is complete: node k has the children 2 k + 1 and 2 k + 2, and of n triangles the leaf l of
2^depth takes those from (l n) >> depth up to ((l + 1) n) >> depth. No node needs a pointer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common.se3 import Array
from services.sim.camera.shapes import Integers

LEAF = 4
"""A leaf holds at least this many triangles, if there are so many, and at most twice as many."""

_MARGIN_M = 1e-9
"""Boxes are larger by this: far above rounding."""


@dataclass(frozen=True, eq=False)
class BoxTree:
    """Boxes of n triangles.

    Args:
        order: (n,) which triangle comes in each place.
        boxes: (2^(depth + 1) - 1, 2, 3) lower and upper corner of each node's box.
        depth: Steps from the root to a leaf.
    """

    order: Integers
    boxes: Array
    depth: int


def arrange(corners: Array) -> BoxTree:
    """Halve the triangles at the median of the longest side, level by level.

    Args:
        corners: (n, 3, 3) of at least one triangle [m].
    """
    count = len(corners)
    depth = max(0, (count // LEAF).bit_length() - 1)
    lower, upper = corners.min(axis=1), corners.max(axis=1)
    middles = 0.5 * (lower + upper)
    order = np.arange(count)
    for level in range(depth):
        order = order[_sort_nodes(middles[order], _starts(count, level))]
    lower, upper = lower[order] - _MARGIN_M, upper[order] + _MARGIN_M
    levels = [_starts(count, level)[:-1] for level in range(depth + 1)]
    bounds = [np.minimum.reduceat(lower, starts) for starts in levels]
    others = [np.maximum.reduceat(upper, starts) for starts in levels]
    boxes = np.stack([np.concatenate(bounds), np.concatenate(others)], axis=1)
    return BoxTree(order, boxes, depth)


def _starts(count: int, level: int) -> Integers:
    """First place of each node of a level, and the end."""
    return (np.arange((1 << level) + 1) * count) >> level


def _sort_nodes(middles: Array, starts: Integers) -> Integers:
    """Sort the triangles of each node along the side on which their middles spread most."""
    lowest = np.minimum.reduceat(middles, starts[:-1])
    spread = np.maximum.reduceat(middles, starts[:-1]) - lowest
    node = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    along = middles[np.arange(len(middles)), spread.argmax(axis=1)[node]]
    return np.lexsort((along, node))
