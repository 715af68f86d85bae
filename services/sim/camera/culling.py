"""Which geoms can each bundle of rays meet at all?

Every geom is replaced by its bounding box with centre c and half axes a_1, a_2, a_3. The answers
err on the safe side, so they change what tracing costs and never what it finds.
"""

from __future__ import annotations

from typing import TypeAlias

import mujoco
import numpy as np
import numpy.typing as npt

from common.se3 import Array

Mask: TypeAlias = npt.NDArray[np.bool_]

HIDDEN_GROUPS = (4, 5)
"""Geom groups that no camera sees: collision shapes and helpers."""

_MARGIN_M = 1e-4
"""Far above the rounding of the single precision used for boxes in pyramids."""

_SKIN_M = 1e-4
"""A box shades a bundle only if it reaches this much above the bundle's lowest point."""

_LEAST_DEPTH_M = 0.02
"""A box that comes closer to the light's height than this may shade anything."""

_ENDLESS_M = 1e3
_TANGENT_MARGIN = _SLOPE_MARGIN = 1e-9

_CORNER_SIGNS = np.array(
    [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float
)
_CORNER_SIGNS.flags.writeable = False


def drawable_geoms(model: mujoco.MjModel) -> Mask:
    """(ngeom,) True for geoms a camera may see: not in a hidden group and not fully transparent."""
    material = np.where(model.geom_matid < 0, 0, model.geom_matid)
    alpha = np.where(
        model.geom_matid < 0,
        model.geom_rgba[:, 3],
        model.mat_rgba[material, 3] if model.nmat else 0.0,
    )
    return (alpha > 0.0) & ~np.isin(model.geom_group, HIDDEN_GROUPS)


class Bounds:
    """Bounding boxes of all drawable geoms of one model, in their own frames."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self.ngeom = int(model.ngeom)
        self.geoms = np.flatnonzero(drawable_geoms(model))
        kind = model.geom_type[self.geoms]
        planes = np.flatnonzero(kind == mujoco.mjtGeom.mjGEOM_PLANE.value)
        self.cylinders = np.flatnonzero(kind == mujoco.mjtGeom.mjGEOM_CYLINDER.value)
        self._center = model.geom_aabb[self.geoms, :3].copy()
        self._half = model.geom_aabb[self.geoms, 3:].copy()
        extent = model.geom_size[self.geoms][planes, :2]
        self._center[planes] = 0.0
        self._half[planes, :2] = np.where(extent > 0.0, extent, _ENDLESS_M)
        self._half[planes, 2] = 0.0

    def place(self, data: mujoco.MjData) -> PlacedBounds:
        """Move the boxes to where the geoms are now."""
        R = data.geom_xmat[self.geoms].reshape(-1, 3, 3)
        center = data.geom_xpos[self.geoms] + (R * self._center[:, None, :]).sum(axis=2)
        return PlacedBounds(self, center, R, self._half)


class PlacedBounds:
    """Bounding boxes of one model at one moment.

    Args:
        bounds: The boxes in their own frames.
        center: (g, 3) centres in the world [m].
        axes: (g, 3, 3) columns: directions of the axes in the world.
        half: (g, 3) half sizes along the axes [m].
    """

    def __init__(self, bounds: Bounds, center: Array, axes: Array, half: Array) -> None:
        self._bounds = bounds
        self._center = center
        self._axes = axes
        self._half = half
        self._half_axes = axes * half[:, None, :]

    def in_pyramids(self, normals: Array, corners: Array, *, apexes: Array) -> Mask:
        """Find what may be met inside pyramids that stand on each apex.

        A box lies wholly outside {x : n . (x - apex) >= 0} if n . (c - apex) + s(n) < 0 with its
        reach s(n) = sum_k |n . a_k|; for a cylinder s(n) = |(n . a_1, n . a_2)| + |n . a_3|. A box
        outside one side of the pyramid cannot be met, nor can a box that has the apex outside one
        of its faces when no edge of the pyramid leads back towards that face.

        Args:
            normals: (tiles, 4, 3) inward normals of the sides of the pyramids.
            corners: (tiles, 4, 3) directions of their edges.
            apexes: (eyes, 3) in the world [m].

        Returns:
            (eyes * tiles, ngeom), eye after eye.
        """
        sides = normals.reshape(-1, 3).astype(np.float32)
        reach = self._reach(sides) + np.float32(_MARGIN_M)
        least, most = self._slopes(corners)
        masks: list[Mask] = []
        for apex in apexes:
            offset = self._center - apex
            within = reach + sides @ offset.T.astype(np.float32) >= 0.0
            inside = within[0::4] & within[1::4] & within[2::4] & within[3::4]
            local = -(self._axes * offset[:, :, None]).sum(axis=1).T
            for axis in range(3):
                limit = self._half[:, axis] + _MARGIN_M
                inside &= ~((local[axis] > limit) & (least[axis] >= _SLOPE_MARGIN))
                inside &= ~((local[axis] < -limit) & (most[axis] <= -_SLOPE_MARGIN))
            masks.append(inside)
        return self.for_all_geoms(np.concatenate(masks))

    def _slopes(self, corners: Array) -> tuple[Array, Array]:
        """Least and greatest slope of pyramids' edges along each box axis: 2 x (3, tiles, g)."""
        edges = corners.reshape(-1, 3)
        slopes = np.stack([edges @ self._axes[:, :, axis].T for axis in range(3)])
        of_edge = [slopes[:, edge::4] for edge in range(4)]
        least = np.minimum(np.minimum(of_edge[0], of_edge[1]), np.minimum(of_edge[2], of_edge[3]))
        most = np.maximum(np.maximum(of_edge[0], of_edge[1]), np.maximum(of_edge[2], of_edge[3]))
        return least, most

    def _reach(self, sides: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        axes = np.ascontiguousarray(self._half_axes.transpose(2, 1, 0), dtype=np.float32)
        first, second, third = (np.abs(sides @ axis) for axis in axes)
        disc = self._bounds.cylinders
        diagonal = np.sqrt(first[:, disc] ** 2 + second[:, disc] ** 2)
        first += second
        first[:, disc] = diagonal
        first += third
        return first

    def seen_from_above(self, light: Array) -> Silhouettes:
        """Outlines of the boxes as a light sees them when it looks straight down."""
        corners = self._center[:, None, :] + (
            _CORNER_SIGNS[None, :, None, :] * self._half_axes[:, None, :, :]
        ).sum(axis=3)
        corners -= light
        depth = -corners[:, :, 2]
        tangents = corners[:, :, :2] / np.maximum(depth, _LEAST_DEPTH_M)[:, :, None]
        low, high, least = tangents.min(axis=1), tangents.max(axis=1), depth.min(axis=1)
        low[least < _LEAST_DEPTH_M], high[least < _LEAST_DEPTH_M] = -np.inf, np.inf
        return Silhouettes(self, low, high, least)

    def for_all_geoms(self, mask: Mask) -> Mask:
        """Widen a mask over the boxes (b, g) to one over all geoms (b, ngeom)."""
        result = np.zeros((len(mask), self._bounds.ngeom), dtype=np.bool_)
        result[:, self._bounds.geoms] = mask
        return result


class Silhouettes:
    """What boxes hide from a light: rectangles in the plane of tangents x/depth, y/depth.

    Args:
        placed: The boxes.
        low: (g, 2) least tangents.
        high: (g, 2) greatest tangents.
        least_depth: (g,) depth of the highest points below the light [m].
    """

    def __init__(self, placed: PlacedBounds, low: Array, high: Array, least_depth: Array) -> None:
        self._placed = placed
        self._low, self._high, self._least_depth = low, high, least_depth

    def may_shade(self, *, low: Array, high: Array, greatest_depth: Array) -> Mask:
        """Find what may stand between the light and bundles of points.

        Args:
            low: (bundles, 2) least tangents of the points.
            high: (bundles, 2) greatest tangents of the points.
            greatest_depth: (bundles,) depth of the lowest point below the light [m].

        Returns:
            (bundles, ngeom).
        """
        above = self._least_depth < greatest_depth[:, None] - _SKIN_M
        for axis in (0, 1):
            above &= self._low[:, axis] <= high[:, axis, None] + _TANGENT_MARGIN
            above &= self._high[:, axis] >= low[:, axis, None] - _TANGENT_MARGIN
        return self._placed.for_all_geoms(above)
