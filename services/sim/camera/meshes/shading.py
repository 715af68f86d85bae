"""Tracing and lighting a bundle of rays in a scene of shapes and meshes.

Light and shadow are those of `camera.shading`. A mesh has the mean of the normals at the corners of
the triangle that is met, weighted by how near they are, so that curved parts look smooth; and no
pattern. Both sides of a triangle are visible.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from common.se3 import Array
from services.sim.camera.compiled import device, stage
from services.sim.camera.meshes.hull import Hull
from services.sim.camera.meshes.room import (
    PART,
    SECOND,
    THIRD,
    TRIANGLE,
    Room,
    may_meet,
    to_shell,
    turn_in,
    turn_out,
)
from services.sim.camera.meshes.walk import flat_normal, walk
from services.sim.camera.primitives import Vector, dot
from services.sim.camera.rays import (
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
    trace,
)
from services.sim.camera.shading import (
    AMBIENT,
    HEADLIGHT,
    LAMBERT,
    LENGTH_M,
    SKY_HORIZON,
    SKY_RISE,
    light_hit,
)
from services.sim.camera.shadows import (
    LIGHT_X_M,
    LIGHT_Y_M,
    LIGHT_Z_M,
    SHADOW_GAP_M,
    cast_shadows,
)
from services.sim.camera.shapes import Integers
from services.sim.camera.tables import Scene
from services.sim.camera.views import EYE


@stage
def sample_with_meshes(
    scene: Scene,
    hull: Hull,
    room: Room,
    eye: Vector,
    count: int,
    candidates: Integers,
    at: int,
    ray_angle_rad: float,
) -> None:
    """Trace and light the first `count` rays of the eye's bundle: SURFACE, FACTOR and TONE.

    Triangle k is surface s + k, where s is the number of surfaces of the scene.

    Args:
        scene: Its rays' directions are given.
        hull: All triangles.
        room: Its places are filled.
        eye: Where the rays start, in the world [m].
        count: How many rays.
        candidates: (n, 1 + g) row `at`: how many shapes may be met, and which, the nearest first.
        at: Which row.
        ray_angle_rad: Angle between neighbouring rays, for the sharpness of patterns.
    """
    rays, marks = scene.rays, scene.marks
    for k in range(count):
        rays[EYE, DISTANCE, k] = LENGTH_M
    trace(rays, marks, EYE, count, scene.shapes, scene.views, candidates, at)
    meet_meshes(hull, room, eye, rays, count, True)
    for k in range(count):
        if room.met[TRIANGLE, k] >= 0:
            light_triangle(hull.corners, hull.normals, room, rays, eye, k)
            marks[EYE, SURFACE, k] = len(scene.surfaces) + room.met[TRIANGLE, k]
        elif marks[EYE, SHAPE_MET, k] >= 0:
            light_hit(rays, marks, k, scene.shapes, scene.surfaces, scene.views, ray_angle_rad)
        else:
            marks[EYE, SURFACE, k] = len(scene.surfaces) - 1
            rays[EYE, FACTOR, k] = SKY_HORIZON + SKY_RISE * rays[EYE, Z, k]
            rays[EYE, TONE, k], rays[EYE, LIT, k] = 1.0, 0.0
    cast_shadows(scene, count)
    meet_meshes(hull, room, (LIGHT_X_M, LIGHT_Y_M, LIGHT_Z_M), rays, count, False)
    for k in range(count):
        rays[EYE, FACTOR, k] += LAMBERT * rays[EYE, LIT, k]


@device
def meet_meshes(
    hull: Hull, room: Room, start: Vector, rays: Array, count: int, from_eye: bool
) -> None:
    """Trace rays against all triangles: from the eye to what is met, or from the light to that.

    Args:
        hull: All triangles.
        room: From the eye, `met` and `weights` are filled.
        start: Eye or light [m].
        rays: Of the eye's bundle. From the eye, DISTANCE is where a ray ends so far, and becomes
            less where a triangle is nearer. From the light, LIT becomes 0 where one is in between.
        count: How many rays.
        from_eye: From there, or else from the light.
    """
    for k in range(count):
        if from_eye:
            d = rays[EYE, X, k], rays[EYE, Y, k], rays[EYE, Z, k]
            limit = rays[EYE, DISTANCE, k]
            room.met[TRIANGLE, k] = -1
        else:
            if rays[EYE, LIT, k] <= 0.0:
                continue
            scale = 1.0 / rays[EYE, RANGE, k]
            d = scale * rays[EYE, TO_X, k], scale * rays[EYE, TO_Y, k], scale * rays[EYE, TO_Z, k]
            limit = rays[EYE, RANGE, k] - SHADOW_GAP_M
        for part in range(len(hull.parts)):
            if not may_meet(room.places, hull.spheres, part, start, d, limit):
                continue
            met, limit, second, third = walk(
                hull.corners,
                hull.boxes,
                hull.parts,
                part,
                to_shell(room.places, part, start),
                turn_in(room.places, part, d),
                limit,
                not from_eye,
                room.waiting,
                room.entries,
            )
            if met < 0:
                continue
            if not from_eye:
                rays[EYE, LIT, k] = 0.0
                break
            rays[EYE, DISTANCE, k] = limit
            room.met[TRIANGLE, k], room.met[PART, k] = met, part
            room.weights[SECOND, k], room.weights[THIRD, k] = second, third


@device
def light_triangle(
    corners: Array,
    normals: npt.NDArray[np.float32],
    room: Room,
    rays: Array,
    eye: Vector,
    k: int,
) -> None:
    """Light ray k's triangle as if nothing cast shadows: FACTOR without point light, LIT, TONE."""
    d, t = (rays[EYE, X, k], rays[EYE, Y, k], rays[EYE, Z, k]), rays[EYE, DISTANCE, k]
    n = world_normal(corners, normals, room, k, d)
    lx, ly, lz = (
        eye[0] + t * d[0] - LIGHT_X_M,
        eye[1] + t * d[1] - LIGHT_Y_M,
        eye[2] + t * d[2] - LIGHT_Z_M,
    )
    range_m = math.sqrt(lx * lx + ly * ly + lz * lz)
    rays[EYE, TO_X, k], rays[EYE, TO_Y, k], rays[EYE, TO_Z, k] = lx, ly, lz
    rays[EYE, RANGE, k] = range_m
    rays[EYE, FACTOR, k] = AMBIENT + HEADLIGHT * max(-dot(n, d), 0.0)
    rays[EYE, LIT, k] = max(-dot(n, (lx, ly, lz)) / range_m, 0.0)
    rays[EYE, TONE, k] = 1.0


@device
def world_normal(
    corners: Array, normals: npt.NDArray[np.float32], room: Room, k: int, d: Vector
) -> Vector:
    """Unit normal in the world where ray k meets its triangle, on the side that the ray sees."""
    at, part = room.met[TRIANGLE, k], room.met[PART, k]
    second, third = room.weights[SECOND, k], room.weights[THIRD, k]
    first = 1.0 - second - third
    x = first * normals[at, 0, 0] + second * normals[at, 1, 0] + third * normals[at, 2, 0]
    y = first * normals[at, 0, 1] + second * normals[at, 1, 1] + third * normals[at, 2, 1]
    z = first * normals[at, 0, 2] + second * normals[at, 1, 2] + third * normals[at, 2, 2]
    flat = flat_normal(corners, at)
    if x * x + y * y + z * z == 0.0:
        x, y, z = flat
    scale = 1.0 / math.sqrt(x * x + y * y + z * z)
    if dot(turn_out(room.places, part, flat), d) > 0.0:
        scale = -scale
    return turn_out(room.places, part, (scale * x, scale * y, scale * z))
