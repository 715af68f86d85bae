"""How bright a hit is: ambient, headlight and one point light with shadow.

For a hit with surface normal n, view ray d and unit vector l to the light, the light factor is

    0.30 + 0.30 max(0, -n . d) + 0.55 s max(0, n . l),

with s = 0 if something stands between light and point, else 1. A picture shows albedo x factor x
tone of the pattern; where nothing is met it shows a sky that brightens with the ray's world z,
0.6 + 0.3 d_z.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from common.se3 import Array
from services.sim.camera.compiled import inlined, stage
from services.sim.camera.normals import normal_of
from services.sim.camera.patterns import PLAIN, tone_of, wave_of
from services.sim.camera.primitives import INFINITE, Vector
from services.sim.camera.rays import (
    BASE,
    DISTANCE,
    FACTOR,
    LIT,
    RANGE,
    SHAPE_MET,
    SURFACE,
    TO_X,
    TO_Y,
    TO_Z,
    TONE,
    X,
    Y,
    Z,
    distance_along,
    trace,
)
from services.sim.camera.shadows import LIGHT_X_M, LIGHT_Y_M, LIGHT_Z_M, cast_shadows
from services.sim.camera.shapes import Integers, Table, to_shape, to_world
from services.sim.camera.tables import Scene
from services.sim.camera.views import EYE

AMBIENT, HEADLIGHT, LAMBERT = 0.30, 0.30, 0.55
SKY_HORIZON, SKY_RISE = 0.6, 0.3

LENGTH_M = 1e10
"""Of view rays."""

_TOP_FACE = 0.9999
"""World z of the normal above which a face counts as horizontal."""

_LEAST_FACING = 1e-3

_GAMMA = 1.0 / 1.6
_LEVELS = 1 << 16


def display_table() -> npt.NDArray[np.uint8]:
    """(65537,) byte of intensity k / 65536: 255 I^(1/1.6)."""
    return np.round(255.0 * (np.arange(_LEVELS + 1) / _LEVELS) ** _GAMMA).astype(np.uint8)


def bytes_of_intensities(intensity: Array) -> npt.NDArray[np.uint8]:
    """Bytes of a whole picture."""
    return display_table()[(np.clip(intensity, 0.0, 1.0) * _LEVELS + 0.5).astype(np.int64)]


def albedo_of_colors(colors: Array) -> Array:
    """Albedo of what shows as these colours (0 to 1) where all lights are full: c^1.6 / 1.15."""
    return colors ** (1.0 / _GAMMA) / (AMBIENT + HEADLIGHT + LAMBERT)


@inlined
def to_display(intensity: float, table: npt.NDArray[np.uint8]) -> int:
    """Byte of an intensity, by table."""
    return table[int(min(max(intensity, 0.0), 1.0) * _LEVELS + 0.5)]


@stage
def sample(
    scene: Scene,
    count: int,
    candidates: Integers,
    at: int,
    ray_angle_rad: float,
    has_shadows: bool,
) -> None:
    """Trace and light the first `count` rays of the eye's bundle: SURFACE, FACTOR, TONE and BASE.

    Args:
        scene: Its rays' directions are given.
        count: How many rays.
        candidates: (n, 1 + g) row `at`: how many shapes may be met, and which, the nearest first.
        at: Which row.
        ray_angle_rad: Angle between neighbouring rays, for the sharpness of patterns.
        has_shadows: Whether things cast shadows.
    """
    rays, marks = scene.rays, scene.marks
    for k in range(count):
        rays[EYE, DISTANCE, k] = LENGTH_M
    trace(rays, marks, EYE, count, scene.shapes, scene.views, candidates, at)
    for k in range(count):
        if marks[EYE, SHAPE_MET, k] < 0:
            marks[EYE, SURFACE, k] = len(scene.surfaces) - 1
            rays[EYE, FACTOR, k] = SKY_HORIZON + SKY_RISE * rays[EYE, Z, k]
            rays[EYE, TONE, k], rays[EYE, LIT, k] = 1.0, 0.0
        else:
            light_hit(rays, marks, k, scene.shapes, scene.surfaces, scene.views, ray_angle_rad)
    if has_shadows:
        cast_shadows(scene, count)
    for k in range(count):
        rays[EYE, FACTOR, k] += LAMBERT * rays[EYE, LIT, k]
        rays[EYE, BASE, k] = scene.surfaces[marks[EYE, SURFACE, k]].gray * rays[EYE, FACTOR, k]


@inlined
def find_tones(
    rays: Array,
    marks: Integers,
    count: int,
    shapes: Table,
    surfaces: Table,
    views: Table,
    ray_angle_rad: float,
) -> None:
    """Find TONE of the first `count` rays of the eye's bundle, whose SURFACE is known.

    A ray that passes by its surface keeps tone 1.
    """
    for k in range(count):
        number = marks[EYE, SURFACE, k] % len(shapes)
        shape, sight = shapes[number], views[EYE, number]
        dx, dy, dz = rays[EYE, X, k], rays[EYE, Y, k], rays[EYE, Z, k]
        t = distance_along(dx, dy, dz, shape, sight)
        rays[EYE, TONE, k] = 1.0
        if t < INFINITE:
            surface = surfaces[marks[EYE, SURFACE, k]]
            nx, ny, nz = world_normal(dx, dy, dz, shape, sight, t)
            spacing_m = ray_angle_rad * t / max(-(nx * dx + ny * dy + nz * dz), _LEAST_FACING)
            rays[EYE, TONE, k] = _tone(surface, shape, sight, (dx, dy, dz), t, spacing_m)


@inlined
def light_hit(
    rays: Array,
    marks: Integers,
    k: int,
    shapes: Table,
    surfaces: Table,
    views: Table,
    ray_angle_rad: float,
) -> None:
    """Light hit k as if nothing cast shadows: SURFACE, FACTOR without point light, LIT, TONE."""
    met, t = marks[EYE, SHAPE_MET, k], rays[EYE, DISTANCE, k]
    shape, sight = shapes[met], views[EYE, met]
    dx, dy, dz = rays[EYE, X, k], rays[EYE, Y, k], rays[EYE, Z, k]
    nx, ny, nz = world_normal(dx, dy, dz, shape, sight, t)
    facing = max(-(nx * dx + ny * dy + nz * dz), 0.0)
    x, y, z = (
        shape.px - sight.cx + t * dx,
        shape.py - sight.cy + t * dy,
        shape.pz - sight.cz + t * dz,
    )
    lx, ly, lz = x - LIGHT_X_M, y - LIGHT_Y_M, z - LIGHT_Z_M
    range_m = math.sqrt(lx * lx + ly * ly + lz * lz)
    rays[EYE, TO_X, k], rays[EYE, TO_Y, k], rays[EYE, TO_Z, k], rays[EYE, RANGE, k] = (
        lx,
        ly,
        lz,
        range_m,
    )
    rays[EYE, FACTOR, k] = AMBIENT + HEADLIGHT * facing
    rays[EYE, LIT, k] = max(-(nx * lx + ny * ly + nz * lz) / range_m, 0.0)
    number = met
    if surfaces[met].has_top and nz > _TOP_FACE:
        number += len(shapes)
    marks[EYE, SURFACE, k] = number
    rays[EYE, TONE, k] = 1.0
    if surfaces[number].pattern != PLAIN:
        spacing_m = ray_angle_rad * t / max(facing, _LEAST_FACING)
        tone = _tone(surfaces[number], shape, sight, (dx, dy, dz), t, spacing_m)
        rays[EYE, TONE, k] = tone


@inlined
def _tone(surface: Any, shape: Any, sight: Any, d: Vector, t: float, spacing_m: float) -> float:
    """Tone of a surface's pattern where a ray with unit direction d meets it at distance t."""
    rays_per_period = surface.period / spacing_m
    world = (
        shape.px - sight.cx + t * d[0],
        shape.py - sight.cy + t * d[1],
        shape.pz - sight.cz + t * d[2],
    )
    lx, ly, lz = to_shape(shape, d[0], d[1], d[2])
    local = (sight.ox + t * lx, sight.oy + t * ly, sight.oz + t * lz)
    wave = wave_of(surface.pattern, world, local, surface.period, surface.salt)
    return tone_of(wave, surface.dark, rays_per_period)


@inlined
def world_normal(
    dx: float, dy: float, dz: float, shape: Any, sight: Any, t: float
) -> tuple[float, float, float]:
    """Outward unit normal in the world where the ray with unit direction d meets a shape at t."""
    local = to_shape(shape, dx, dy, dz)
    start, size = (sight.ox, sight.oy, sight.oz), (shape.sx, shape.sy, shape.sz)
    x, y, z = normal_of(shape.kind, start, local, size, t)
    return to_world(shape, x, y, z)
