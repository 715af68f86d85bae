"""Distances between the robot's own geoms, and to the fixed obstacles of the task."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import coal
import mujoco
import numpy as np
import pinocchio as pin

from common.errors import BadRobotFile
from common.se3 import Array
from common.tasks import Obstacle
from services.retarget.approach import ApproachLimit
from services.retarget.robot_model import RobotModel
from services.retarget.rows import Approach

_GEOM = mujoco.mjtGeom


class Collisions:
    """Pairs that are kept apart: those of `[collision]` in robot.toml.

    Row of a pair: n' (J_p1 - J_p2) a <= speed, with the witness points p1, p2 and n from p1 to p2.
    A pair gets one when it approaches, or could begin to in one tick, faster than it may.

    Args:
        model: The robot.
        obstacles: Fixed boxes of the task.
        limit: Distance to speed of approach.

    Raises:
        BadRobotFile: A geom is neither capsule, sphere, cylinder nor box.
    """

    def __init__(
        self, model: RobotModel, obstacles: Sequence[Obstacle], limit: ApproachLimit
    ) -> None:
        self._model = model
        self._limit = limit
        self._geometry = pin.GeometryModel()
        spec = model.spec.collision
        names = dict.fromkeys(name for pair in spec.pairs for name in pair)
        names |= dict.fromkeys(spec.obstacle_geoms)
        ids = {name: self._add_geom(name) for name in names}
        pairs = [(ids[one], ids[other]) for one, other in spec.pairs]
        for obstacle in obstacles:
            box = self._add_obstacle(obstacle)
            pairs += [(ids[name], box) for name in spec.obstacle_geoms]
        for one, other in pairs:
            self._geometry.addCollisionPair(pin.CollisionPair(one, other))
        self._data = self._geometry.createData()
        for request in self._data.distanceRequests:
            request.gjk_tolerance = _WITNESS_TOLERANCE
        # Each is filled anew in its place. Looping over the vector itself costs more than all
        # distances: its end is told by a C++ exception.
        self._results = list(self._data.distanceResults)
        self._pairs = [self._describe(pair) for pair in self._geometry.collisionPairs]
        self._change_m_s = [self._bound_change(pair) for pair in self._geometry.collisionPairs]
        self._far_m = [limit.distance(_FAST_M_S + change) for change in self._change_m_s]
        self._fast_m = _FAST_M_S * limit.dt_s
        self._distances_m: list[float] = []

    def __bool__(self) -> bool:
        return bool(self._pairs)

    def list_near(self) -> list[Approach]:
        """Pairs that matter in this tick, at the configuration of `RobotModel.update`."""
        model = self._model
        pin.updateGeometryPlacements(model.pin, model.data, self._geometry, self._data)
        pin.computeDistances(self._geometry, self._data)
        distances_m = [result.min_distance for result in self._results]
        before_m, self._distances_m = self._distances_m or distances_m, distances_m
        near: list[Approach] = []
        gaps = zip(distances_m, before_m, self._far_m, strict=True)
        for i, (distance_m, before, far_m) in enumerate(gaps):
            # Far pairs, nearly all of them, need no more than this.
            if distance_m > far_m and before - distance_m < self._fast_m:
                continue
            approach = max(before - distance_m, 0.0) / self._limit.dt_s
            speed = self._limit.speed(distance_m)
            if speed < approach + self._change_m_s[i]:
                near.append(self._make_row(i, self._results[i], distance_m, speed))
        return near

    def _make_row(self, index: int, result: Any, distance_m: float, speed: float) -> Approach:
        name, one, other = self._pairs[index]
        n: Array = result.normal
        row = self._project(one, result.getNearestPoint1(), n)
        row = row - self._project(other, result.getNearestPoint2(), n)
        return Approach(row, distance_m, speed, name)

    def _project(self, joint: int, point: Array, n: Array) -> Array:
        """Row n' J_p (n,) of a point that a joint carries."""
        if joint == 0:
            return np.zeros(self._model.pin.nv)
        model = self._model
        J = pin.getJointJacobian(model.pin, model.data, joint, pin.LOCAL_WORLD_ALIGNED)
        x, y, z = (point - model.data.oMi[joint].translation).tolist()
        n_x, n_y, n_z = n.tolist()
        # n' (v + w x r) = n' v + (r x n)' w
        turning = (y * n_z - z * n_y, z * n_x - x * n_z, x * n_y - y * n_x)
        return np.array([n_x, n_y, n_z, *turning]) @ J

    def _describe(self, pair: Any) -> tuple[str, int, int]:
        one = self._geometry.geometryObjects[pair.first]
        other = self._geometry.geometryObjects[pair.second]
        return f"{one.name}-{other.name}", int(one.parentJoint), int(other.parentJoint)

    def _bound_change(self, pair: Any) -> float:
        """More than one tick's accelerations can change a pair's speed of approach [m/s].

        Joints that move both geoms alike change no distance.
        """
        ends = [self._geometry.geometryObjects[end] for end in (pair.first, pair.second)]
        one, other = (set(self._model.pin.supports[end.parentJoint]) for end in ends)
        return self._bound_gain(ends[0], one - other) + self._bound_gain(ends[1], other - one)

    def _bound_gain(self, geom: Any, joints: set[int]) -> float:
        """More than some joints' accelerations can make a geom's points faster in one tick [m/s].

        dt sum_j A_j r_j: A_j acceleration limit; r_j is 1 for a slide, else how far the geom can be
        from the joint: its own extent from the joint that carries it, and the links between.
        """
        model = self._model.pin
        reach_m = _measure_extent(geom)
        gain_m_s2 = 0.0
        for joint in sorted(joints, reverse=True):
            slides = "Prismatic" in model.joints[joint].shortname()
            index = model.joints[joint].idx_v
            limit = self._model.spec.joints[index].acceleration_limit
            gain_m_s2 += limit * (1.0 if slides else reach_m)
            reach_m += float(np.linalg.norm(model.jointPlacements[joint].translation))
            if slides:
                ends = model.lowerPositionLimit[index], model.upperPositionLimit[index]
                reach_m += float(np.abs(ends).max())
        return gain_m_s2 * self._limit.dt_s

    def _add_geom(self, name: str) -> int:
        joint, placement = self._model.place_geom(name)
        shape = _make_shape(self._model, name)
        return self._geometry.addGeometryObject(pin.GeometryObject(name, joint, placement, shape))

    def _add_obstacle(self, obstacle: Obstacle) -> int:
        x, y, z = obstacle.half_size_m
        box = coal.Box(2.0 * x, 2.0 * y, 2.0 * z)
        placement = pin.SE3(obstacle.T_world_box)
        return self._geometry.addGeometryObject(
            pin.GeometryObject(obstacle.name, 0, placement, box)
        )


def _make_boxes_exact() -> None:
    """Let coal take boxes as they are, whatever is computed first in this process.

    coal 3.0.3 widens all boxes by a factor of 1 + 1e-10, or does not, for the life of the process:
    its support function of a box keeps a static that the direction of the very first call sets. A
    first call along no axis sets it to 1. Without this, a robot's trace would depend on which robot
    came before it.
    """
    request = coal.DistanceRequest()
    request.gjk_initial_guess = coal.GJKInitialGuess.CachedGuess
    request.cached_gjk_guess = np.array([0.3, 0.5, 0.7])
    here, there = coal.Transform3s(), coal.Transform3s(np.eye(3), np.array([3.0, 5.0, 7.0]))
    coal.distance(
        coal.Box(1, 1, 1), here, coal.Capsule(1, 1), there, request, coal.DistanceResult()
    )


_make_boxes_exact()

_WITNESS_TOLERANCE = 1e-9
_FAST_M_S = 0.3
"""Pairs that approach slower than this and are far enough apart are not looked at closer."""


def _measure_extent(geom: Any) -> float:
    """Radius [m] of a sphere about the joint that carries a geom, which holds the geom."""
    shape = geom.geometry
    shape.computeLocalAABB()
    return float(np.linalg.norm(geom.placement.translation)) + shape.aabb_radius


def _make_shape(model: RobotModel, name: str) -> Any:
    geom = model.mj.geom(name).id
    radius, half, height = model.mj.geom_size[geom].tolist()
    kind = int(model.mj.geom_type[geom])
    if kind == int(_GEOM.mjGEOM_SPHERE):
        return coal.Sphere(radius)
    if kind == int(_GEOM.mjGEOM_CAPSULE):
        return coal.Capsule(radius, 2.0 * half)
    if kind == int(_GEOM.mjGEOM_CYLINDER):
        return coal.Cylinder(radius, 2.0 * half)
    if kind == int(_GEOM.mjGEOM_BOX):
        return coal.Box(2.0 * radius, 2.0 * half, 2.0 * height)
    raise BadRobotFile(
        model.spec.name, f"geom {name}", "is neither sphere, capsule, cylinder nor box"
    )
