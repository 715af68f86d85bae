"""Room for one picture with meshes: where the shells are, and which triangles the rays meet."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from common.se3 import Array
from services.sim.camera.compiled import device
from services.sim.camera.meshes.walk import DEEPEST
from services.sim.camera.primitives import Vector
from services.sim.camera.shapes import Integers

TRIANGLE, PART = range(2)
"""Rows of `Room.met`."""

SECOND, THIRD = range(2)
"""Rows of `Room.weights`."""

ORIGIN, ROTATION, MIDDLE, PLACES = 0, 3, 12, 15
"""Columns of `Room.places`: where the vectors and the matrix begin."""


class Room(NamedTuple):
    """Room for s shells and bundles of at most m rays.

    Args:
        places: (s, 15) origin, rotation by rows and middle of the sphere of each shell, in the
            world.
        met: (2, m) triangle that each ray of the eye's bundle meets, -1 if none, and its shell.
        weights: (2, m) of the second and third corner of that triangle.
        waiting, entries: (DEEPEST,) see `walk`.
    """

    places: Array
    met: Integers
    weights: Array
    waiting: Integers
    entries: Array


def make_room(shells: int, most: int) -> Room:
    """Room for so many shells and rays."""
    return Room(
        places=np.zeros((shells, PLACES)),
        met=np.zeros((2, most), dtype=np.int64),
        weights=np.zeros((2, most)),
        waiting=np.zeros(DEEPEST, dtype=np.int64),
        entries=np.zeros(DEEPEST),
    )


@device
def place_shells(
    places: Array, spheres: Array, bodies: Integers, body_xpos: Array, body_xmat: Array
) -> None:
    """Copy the poses of the bodies that carry shells from `MjData`."""
    for part in range(len(places)):
        body = bodies[part]
        for k in range(3):
            places[part, ORIGIN + k] = body_xpos[body, k]
        for k in range(9):
            places[part, ROTATION + k] = body_xmat[body, k]
        x, y, z = turn_out(places, part, (spheres[part, 0], spheres[part, 1], spheres[part, 2]))
        places[part, MIDDLE] = body_xpos[body, 0] + x
        places[part, MIDDLE + 1] = body_xpos[body, 1] + y
        places[part, MIDDLE + 2] = body_xpos[body, 2] + z


@device
def turn_out(places: Array, part: int, v: Vector) -> Vector:
    """A vector of a shell's frame in the world."""
    return (
        places[part, 3] * v[0] + places[part, 4] * v[1] + places[part, 5] * v[2],
        places[part, 6] * v[0] + places[part, 7] * v[1] + places[part, 8] * v[2],
        places[part, 9] * v[0] + places[part, 10] * v[1] + places[part, 11] * v[2],
    )


@device
def turn_in(places: Array, part: int, v: Vector) -> Vector:
    """A vector of the world in a shell's frame."""
    return (
        places[part, 3] * v[0] + places[part, 6] * v[1] + places[part, 9] * v[2],
        places[part, 4] * v[0] + places[part, 7] * v[1] + places[part, 10] * v[2],
        places[part, 5] * v[0] + places[part, 8] * v[1] + places[part, 11] * v[2],
    )


@device
def to_shell(places: Array, part: int, p: Vector) -> Vector:
    """A point of the world in a shell's frame."""
    return turn_in(
        places,
        part,
        (
            p[0] - places[part, ORIGIN],
            p[1] - places[part, ORIGIN + 1],
            p[2] - places[part, ORIGIN + 2],
        ),
    )


@device
def may_meet(
    places: Array, spheres: Array, part: int, start: Vector, d: Vector, limit: float
) -> bool:
    """Whether a ray comes near a shell before its end: |c - o - t d| <= r for a t in (0, limit)."""
    x, y, z = (
        places[part, MIDDLE] - start[0],
        places[part, MIDDLE + 1] - start[1],
        places[part, MIDDLE + 2] - start[2],
    )
    radius, along = spheres[part, 3], x * d[0] + y * d[1] + z * d[2]
    beside = x * x + y * y + z * z - along * along
    return (beside <= radius * radius) & (along >= -radius) & (along <= limit + radius)
