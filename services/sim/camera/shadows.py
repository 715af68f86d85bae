"""What the light reaches: rays from the light, bundled by the cell of a grid below it.

The light looks straight down. A cell is a square of the plane of tangents x/depth, y/depth; what
may stand in its pyramid is looked up when the first point of a picture lies in it. Points beside
the grid, or not below the light, share one more cell that holds all shapes.
"""

from __future__ import annotations

import math

from common.se3 import Array
from services.sim.camera.compiled import device, inlined, stage
from services.sim.camera.culling import find_candidates
from services.sim.camera.pyramids import raise_pyramid
from services.sim.camera.rays import (
    CELL,
    DISTANCE,
    LIT,
    POINT,
    RANGE,
    SHAPE_MET,
    TO_X,
    TO_Y,
    TO_Z,
    X,
    Y,
    Z,
    trace,
)
from services.sim.camera.shapes import Integers, Table
from services.sim.camera.tables import CELLS, CELLS_TO_A_SIDE, LIGHT_DOWN, Scene
from services.sim.camera.views import EYE, LIGHT, look_from

LIGHT_X_M, LIGHT_Y_M, LIGHT_Z_M = 0.2, -0.8, 2.4
"""The point light in the world."""

SHADOW_GAP_M = 3e-3
"""Something shades a point only if it is at least this much nearer to the light."""

_CELL_TANGENT = 0.1
_SIDE = 2 * CELLS_TO_A_SIDE
_ELSEWHERE = CELLS - 1
_UNKNOWN = -1

_LEAST_DEPTH_M = 1e-3
_MARGIN_TANGENT = 1e-9


@device
def open_shadows(shapes: Table, views: Table, light_cells: Integers) -> None:
    """Begin a picture: look from the light, forget what stands in the cells."""
    look_from(LIGHT_X_M, LIGHT_Y_M, LIGHT_Z_M, shapes, views, LIGHT)
    for cell in range(CELLS):
        light_cells[cell, 0] = _UNKNOWN


@device
def cell_of(x: float, y: float, z: float) -> int:
    """Cell of the point at (x, y, z) from the light."""
    if -z < _LEAST_DEPTH_M:
        return _ELSEWHERE
    scale = 1.0 / (_CELL_TANGENT * -z)
    column = math.floor(scale * x) + float(CELLS_TO_A_SIDE)
    row = math.floor(scale * -y) + float(CELLS_TO_A_SIDE)
    if column < 0.0 or column >= _SIDE or row < 0.0 or row >= _SIDE:
        return _ELSEWHERE
    return int(row) * _SIDE + int(column)


@stage
def cast_shadows(scene: Scene, count: int) -> None:
    """Put out `LIT` of those of the first `count` hits of the eye's bundle that lie in shadow."""
    rays, marks = scene.rays, scene.marks
    for k in range(count):
        marks[EYE, CELL, k] = _UNKNOWN
        if rays[EYE, LIT, k] > 0.0:
            cell = cell_of(rays[EYE, TO_X, k], rays[EYE, TO_Y, k], rays[EYE, TO_Z, k])
            if scene.light_cells[cell, 0] == _UNKNOWN:
                _look_up(
                    scene.frames,
                    scene.light_pyramid,
                    scene.shapes,
                    scene.views,
                    scene.light_cells,
                    cell,
                )
            met, range_m = marks[EYE, SHAPE_MET, k], rays[EYE, RANGE, k]
            if not _is_in_front(scene.light_cells, cell, scene.views, met, range_m):
                marks[EYE, CELL, k] = cell
    for first in range(count):
        cell = marks[EYE, CELL, first]
        if cell != _UNKNOWN:
            number = _gather(rays, marks, cell, first, count)
            trace(
                rays,
                marks,
                LIGHT,
                number,
                scene.shapes,
                scene.views,
                scene.light_cells,
                cell,
            )
            for k in range(number):
                if marks[LIGHT, SHAPE_MET, k] >= 0:
                    rays[EYE, LIT, marks[LIGHT, POINT, k]] = 0.0


@inlined
def _is_in_front(light_cells: Integers, cell: int, views: Table, met: int, range_m: float) -> bool:
    """Whether nothing but the shape that is met can be between the light and a hit.

    No shape shades its own lit side: all are convex, or have one visible side.
    """
    count = light_cells[cell, 0]
    if count == 0 or light_cells[cell, 1] != met:
        return False
    return count == 1 or views[LIGHT, light_cells[cell, 2]].nearest >= range_m


@device
def _gather(rays: Array, marks: Integers, cell: int, first: int, count: int) -> int:
    """Aim rays from the light at all hits of one cell, the first of which is number `first`."""
    number = 0
    for k in range(first, count):
        if marks[EYE, CELL, k] == cell:
            marks[EYE, CELL, k] = _UNKNOWN
            marks[LIGHT, POINT, number] = k
            range_m = rays[EYE, RANGE, k]
            rays[LIGHT, X, number] = rays[EYE, TO_X, k] / range_m
            rays[LIGHT, Y, number] = rays[EYE, TO_Y, k] / range_m
            rays[LIGHT, Z, number] = rays[EYE, TO_Z, k] / range_m
            rays[LIGHT, DISTANCE, number] = range_m - SHADOW_GAP_M
            number += 1
    return number


@device
def _look_up(
    frames: Array, pyramid: Array, shapes: Table, views: Table, light_cells: Integers, cell: int
) -> None:
    """Find what may stand in one cell."""
    row, column = cell // _SIDE - CELLS_TO_A_SIDE, cell % _SIDE - CELLS_TO_A_SIDE
    left = column * _CELL_TANGENT if cell != _ELSEWHERE else math.nan
    top = row * _CELL_TANGENT
    raise_pyramid(
        frames,
        LIGHT_DOWN,
        left - _MARGIN_TANGENT,
        left + _CELL_TANGENT + _MARGIN_TANGENT,
        top - _MARGIN_TANGENT,
        top + _CELL_TANGENT + _MARGIN_TANGENT,
        pyramid,
        0,
    )
    find_candidates(pyramid, 0, shapes, views, LIGHT, light_cells, cell)
