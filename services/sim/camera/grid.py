"""Which pixels are traced, and how the others are filled.

The adaptive grid traces every second pixel, and of the others those that may hide an edge. A pixel
between coarse places is uneven if those around it see different surfaces, or their intensities
without patterns differ by more than `REFINE_STEP`. Uneven pixels are traced; others get the mean of
their coarse neighbours, and if their surface has a pattern, its tone where their own ray meets that
surface.

A picture is made in passes over its tiles: one with every pixel; or one with the coarse places,
then one with the uneven pixels.
"""

from __future__ import annotations

from common.se3 import Array
from services.sim.camera.compiled import inlined
from services.sim.camera.desk import PATTERN_TONE, PLAIN_LIGHT
from services.sim.camera.lens import Flags
from services.sim.camera.patterns import PLAIN
from services.sim.camera.rays import (
    BASE,
    COLUMN,
    FACTOR,
    ROW,
    SURFACE,
    TONE,
    WAITING,
    X,
    Y,
    Z,
)
from services.sim.camera.shading import to_display
from services.sim.camera.shapes import Integers, Table
from services.sim.camera.views import EYE

REFINE_STEP = 0.04
"""Coarse neighbours that differ by more than this in intensity have an edge between them."""

EVERY, COARSE, UNEVEN, PASSES = range(4)


@inlined
def list_places(flags: Flags, tiles: Integers, tile: int, step: int, marks: Integers) -> int:
    """Make a bundle of the places of a tile, every `step` rows and columns, that have a flag."""
    bottom = min(tiles[tile, 1], step * flags.shape[0])
    right = min(tiles[tile, 3], step * flags.shape[1])
    count = 0
    for row in range(tiles[tile, 0], bottom, step):
        for column in range(tiles[tile, 2], right, step):
            if flags[row // step, column // step]:
                marks[EYE, ROW, count], marks[EYE, COLUMN, count] = row, column
                count += 1
    return count


@inlined
def aim(rays: Array, marks: Integers, count: int, directions: Array, R: Array) -> None:
    """Turn rays of the eye's bundle into the world: R (3, 3) times directions[ROW, COLUMN]."""
    for k in range(count):
        row, column = marks[EYE, ROW, k], marks[EYE, COLUMN, k]
        x, y, z = directions[row, column, 0], directions[row, column, 1], directions[row, column, 2]
        rays[EYE, X, k] = R[0, 0] * x + R[0, 1] * y + R[0, 2] * z
        rays[EYE, Y, k] = R[1, 0] * x + R[1, 1] * y + R[1, 2] * z
        rays[EYE, Z, k] = R[2, 0] * x + R[2, 1] * y + R[2, 2] * z


@inlined
def keep_places(
    rays: Array,
    marks: Integers,
    count: int,
    step: int,
    surface: Integers,
    light: Array,
) -> None:
    """Keep what `count` rays of the eye's bundle see, every pixel's (step 1) or coarse (step 2).

    Args:
        rays: Bundles.
        marks: Their integers.
        count: How many rays.
        step: Rows and columns of the lattice from one place to the next.
        surface: (r, c) is filled.
        light: (2, r, c) is filled, see `desk.Desk`.
    """
    for k in range(count):
        i, j = marks[EYE, ROW, k] // step, marks[EYE, COLUMN, k] // step
        surface[i, j] = marks[EYE, SURFACE, k]
        light[PLAIN_LIGHT, i, j] = rays[EYE, FACTOR, k] if step == 1 else rays[EYE, BASE, k]
        light[PATTERN_TONE, i, j] = rays[EYE, TONE, k]


@inlined
def show(
    rays: Array, marks: Integers, count: int, pictures: Flags, eye: int, bytes_of: Flags
) -> None:
    """Put the first `count` pixels of the eye's bundle into a picture."""
    for k in range(count):
        intensity = rays[EYE, BASE, k] * rays[EYE, TONE, k]
        row, column = marks[EYE, ROW, k], marks[EYE, COLUMN, k]
        pictures[eye, row, column] = to_display(intensity, bytes_of)


@inlined
def fill_even(
    inside: Flags,
    tiles: Integers,
    tile: int,
    surface: Integers,
    light: Array,
    surfaces: Table,
    rays: Array,
    marks: Integers,
    pictures: Flags,
    eye: int,
    bytes_of: Flags,
) -> tuple[int, int]:
    """Fill a tile's pixels that need no ray.

    Args:
        inside: Pixels inside the image circle.
        tiles: Of the lens.
        tile: Which tile.
        surface: (r, c) what the coarse grid sees.
        light: (2, r, c) there: intensity without pattern, tone.
        surfaces: What surfaces look like.
        rays: Bundles: BASE of waiting pixels is filled.
        marks: Places of uneven pixels go to the eye's bundle; places and surfaces of pixels that
            wait for the tone of their pattern to the waiting bundle.
        pictures: (eyes, height, width).
        eye: Which of them.
        bytes_of: Of intensities.

    Returns:
        How many uneven and how many waiting pixels.
    """
    uneven, waiting = 0, 0
    for row in range(tiles[tile, 0], min(tiles[tile, 1], inside.shape[0])):
        for column in range(tiles[tile, 2], min(tiles[tile, 3], inside.shape[1])):
            if not inside[row, column]:
                continue
            i, j = row // 2, column // 2
            met, even, mean = _compare(surface, light, i, j, i + row % 2, j + column % 2)
            if not even:
                marks[EYE, ROW, uneven], marks[EYE, COLUMN, uneven] = row, column
                uneven += 1
                continue
            if row % 2 == 0 and column % 2 == 0:
                mean *= light[PATTERN_TONE, i, j]
            elif surfaces[met].pattern != PLAIN:
                marks[WAITING, ROW, waiting], marks[WAITING, COLUMN, waiting] = row, column
                marks[WAITING, SURFACE, waiting], rays[WAITING, BASE, waiting] = met, mean
                waiting += 1
                continue
            pictures[eye, row, column] = to_display(mean, bytes_of)
    return uneven, waiting


@inlined
def _compare(
    surface: Integers, light: Array, i: int, j: int, below: int, beside: int
) -> tuple[int, bool, float]:
    """Surface, evenness and mean intensity of the one, two or four coarse places around a pixel."""
    a, b = light[PLAIN_LIGHT, i, j], light[PLAIN_LIGHT, i, beside]
    c, d = light[PLAIN_LIGHT, below, j], light[PLAIN_LIGHT, below, beside]
    low, high = min(min(a, b), min(c, d)), max(max(a, b), max(c, d))
    met = surface[i, j]
    same = (
        (met == surface[i, beside]) & (met == surface[below, j]) & (met == surface[below, beside])
    )
    return met, same & (high - low <= REFINE_STEP), 0.25 * (a + b + c + d)


@inlined
def take_waiting(rays: Array, marks: Integers, count: int) -> None:
    """Make the waiting pixels the eye's bundle."""
    for k in range(count):
        for mark in (ROW, COLUMN, SURFACE):
            marks[EYE, mark, k] = marks[WAITING, mark, k]
        rays[EYE, BASE, k] = rays[WAITING, BASE, k]
