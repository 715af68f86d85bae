"""All triangles of a robot, packed for the kernel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from common.robots.meshes import Shell
from common.se3 import Array
from services.sim.camera.lens import freeze
from services.sim.camera.meshes.boxes import arrange
from services.sim.camera.shapes import Integers

FIRST_BOX, FIRST_TRIANGLE, COUNT, DEPTH = range(4)
"""Columns of `Hull.parts`."""


class Hull(NamedTuple):
    """Tables of s shells with n triangles in all, read-only.

    Args:
        corners: (n, 3, 3) in the frame of the body that carries the shell [m].
        normals: (n, 3, 3) at the corners.
        boxes: (b, 2, 3) the trees of all shells, one after the other, see `boxes`.
        parts: (s, 4) first box, first triangle, number of triangles and depth of each shell.
        spheres: (s, 4) middle and radius of a sphere around each [m].
    """

    corners: Array
    normals: npt.NDArray[np.float32]
    boxes: Array
    parts: Integers
    spheres: Array


def pack(shells: Sequence[Shell]) -> tuple[Hull, Array]:
    """Tables of shells, none of them empty, and (n, 3) the colours of their triangles."""
    trees = [arrange(shell.corners) for shell in shells]
    parts, box, triangle = np.zeros((len(shells), 4), dtype=np.int64), 0, 0
    for part, tree in zip(parts, trees, strict=True):
        part[:] = box, triangle, len(tree.order), tree.depth
        box, triangle = box + len(tree.boxes), triangle + len(tree.order)
    pairs = list(zip(shells, trees, strict=True))
    hull = Hull(
        corners=freeze(np.concatenate([shell.corners[tree.order] for shell, tree in pairs])),
        normals=freeze(
            np.concatenate([shell.normals[tree.order] for shell, tree in pairs]).astype(np.float32)
        ),
        boxes=freeze(np.concatenate([tree.boxes for tree in trees])),
        parts=freeze(parts),
        spheres=freeze(np.array([_enclose(tree.boxes[0]) for tree in trees])),
    )
    return hull, freeze(np.concatenate([shell.colors[tree.order] for shell, tree in pairs]))


def _enclose(box: Array) -> Array:
    """Middle and radius (4,) of the sphere around a box (2, 3)."""
    return np.append(box.mean(axis=0), 0.5 * np.sqrt(((box[1] - box[0]) ** 2).sum()))
