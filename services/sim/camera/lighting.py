"""How bright a hit is: ambient, headlight and one point light with shadow.

For a hit with surface normal n, view ray d and unit vector l to the light, the light factor is

    0.30 + 0.30 max(0, -n . d) + 0.55 s max(0, n . l),

with s = 0 if something stands between light and point, else 1. A picture shows albedo x factor;
where nothing is met it shows a sky that brightens with the ray's world z.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import numpy.typing as npt

from common.se3 import Array
from services.sim.camera.bundles import Indices
from services.sim.camera.culling import Silhouettes
from services.sim.camera.surface import Integers, Surfaces
from services.sim.camera.tracer import Hits, Tracer

LIGHT_M = (0.2, -0.8, 2.4)
"""The point light in the world."""

_LIGHT_COLUMN = np.array([LIGHT_M]).T
_LIGHT_COLUMN.flags.writeable = False

AMBIENT, HEADLIGHT, LAMBERT = 0.30, 0.30, 0.55
SKY_HORIZON, SKY_RISE = 0.6, 0.3

_SHADOW_GAP_M = 3e-3
"""Something shades a point only if it is at least this much nearer to the light."""

_CELL_TANGENT = 0.13
"""Shadow rays are bundled by cells of this size, in units of depth below the light."""

_LEAST_DEPTH_M = 1e-3
"""Bundles with a point less than this below the light may be shaded by anything."""

_EXTREMES = (np.minimum, np.maximum)

_GAMMA = 1.0 / 1.6
_LEVELS = 1 << 16
_DISPLAY = np.round(255.0 * (np.arange(_LEVELS + 1) / _LEVELS) ** _GAMMA).astype(np.uint8)
_DISPLAY.flags.writeable = False


def to_display(intensity: npt.NDArray[np.floating]) -> npt.NDArray[np.uint8]:
    """Bytes of a picture: 255 clip(I, 0, 1)^(1/1.6), by table."""
    level = np.clip(intensity, 0.0, 1.0)
    level *= _LEVELS
    level += 0.5
    return _DISPLAY[level.astype(np.int32)]


def sky(direction_z: Array) -> Array:
    """Brightness where nothing is met: 0.6 + 0.3 d_z with d_z the world z of the unit ray."""
    return SKY_HORIZON + SKY_RISE * direction_z


@dataclass(frozen=True)
class Lit:
    """The look of n hits, apart from their albedo.

    Args:
        surface: (n,) as in `Surfaces`; -1 where nothing was met.
        factor: (n,) light factor, without pattern.
        tone: (n,) brightness of the pattern.
        z_m: (n,) height of the hits in the world.
    """

    surface: Integers
    factor: Array
    tone: Array
    z_m: Array


class Lighting:
    """Computes light factors of hits, with shadows.

    Args:
        surfaces: Colours and patterns of the model that is looked at.
        tracer: Traces the rays from the light.
        ray_angle_rad: Angle between neighbouring view rays, for the sharpness of patterns.
        shadows: Whether things cast shadows.
    """

    def __init__(
        self,
        surfaces: Surfaces,
        tracer: Tracer,
        *,
        ray_angle_rad: float,
        shadows: bool,
    ) -> None:
        self._surfaces = surfaces
        self._tracer = tracer
        self._ray_angle_rad = ray_angle_rad
        self._shadows = shadows

    def light(
        self,
        data: mujoco.MjData,
        silhouettes: Silhouettes,
        *,
        hits: Hits,
        origins: Array,
        rays: Array,
    ) -> Lit:
        """Light the hits of n view rays.

        Args:
            data: Kinematics are up to date.
            silhouettes: What may cast shadows, as the light sees it.
            hits: Of the view rays.
            origins: (3, n) where the rays start, in the world [m].
            rays: (3, n) unit vectors in the world.
        """
        d_x, d_y, d_z = rays
        n_x, n_y, n_z = np.ascontiguousarray(hits.normal.T)
        facing = np.maximum(-(n_x * d_x + n_y * d_y + n_z * d_z), 0.0)
        points = origins + hits.distance * rays
        x, y, z = to_point = points - _LIGHT_COLUMN
        range_m = np.sqrt(x * x + y * y + z * z)
        lambert = np.maximum(-(n_x * x + n_y * y + n_z * z) / range_m, 0.0)
        surface = self._surfaces.surface(hits.geom, n_z)
        if self._shadows:
            lit = np.flatnonzero(lambert)
            shaded = self._shaded(data, silhouettes, to_point[:, lit], range_m[lit])
            lambert[lit[shaded]] = 0.0
        return Lit(
            surface=surface,
            factor=AMBIENT + HEADLIGHT * facing + LAMBERT * lambert,
            tone=self._tone(surface, points, hits.distance, facing),
            z_m=points[2],
        )

    def tone_at_height(
        self, surface: Integers, *, origins: Array, rays: Array, z_m: Array
    ) -> Array:
        """Brightness of the pattern where rays pierce a horizontal face, without tracing them.

        Args:
            surface: (n,) the surfaces that are met.
            origins: (3, n) where the rays start, in the world [m].
            rays: (3, n) unit vectors in the world.
            z_m: (n,) heights of the faces.
        """
        distance = (z_m - origins[2]) / rays[2]
        return self._tone(surface, origins + distance * rays, distance, -rays[2])

    def _tone(self, surface: Integers, points: Array, distance: Array, facing: Array) -> Array:
        result = np.ones(len(surface))
        at = np.flatnonzero(self._surfaces.is_checkered(surface))
        spacing_m = self._ray_angle_rad * distance.take(at) / np.maximum(facing.take(at), 1e-3)
        x, y = points[0].take(at), points[1].take(at)
        result[at] = self._surfaces.tone(surface.take(at), x, y, spacing_m)
        return result

    def _shaded(
        self, data: mujoco.MjData, silhouettes: Silhouettes, to_point: Array, range_m: Array
    ) -> Indices:
        """Which of these points the light does not reach; (3, n) vectors run from it to them."""
        if not len(range_m):
            return np.empty(0, dtype=np.intp)
        depth = -to_point[2]
        tangents = to_point[:2] / np.maximum(depth, _LEAST_DEPTH_M)
        cell = _cell(tangents)
        order = np.argsort(cell, kind="stable")
        cell, depth, tangents = cell[order], depth[order], tangents[:, order]
        first = np.flatnonzero(np.append(True, cell[1:] != cell[:-1]))
        low, high = (reduce.reduceat(tangents, first, axis=1).T for reduce in _EXTREMES)
        above_light = np.minimum.reduceat(depth, first) < _LEAST_DEPTH_M
        low[above_light], high[above_light] = -np.inf, np.inf
        hits = self._tracer.trace_bundles(
            data,
            origins=np.broadcast_to(np.array(LIGHT_M), (len(first), 3)),
            directions=to_point.T[order],
            starts=np.append(first, len(order)),
            candidates=silhouettes.may_shade(
                low=low, high=high, greatest_depth=np.maximum.reduceat(depth, first)
            ),
        )
        nearer = hits.distance < 1.0 - _SHADOW_GAP_M / range_m[order]
        return order[np.flatnonzero(nearer & (hits.geom >= 0))]


def _cell(tangents: Array) -> npt.NDArray[np.uint16]:
    """(n,) cell of a square grid seen from the light; cells repeat far to the side, harmlessly."""
    column, row = np.floor(tangents * (1.0 / _CELL_TANGENT)).astype(np.int32) & 0xFF
    return (row * 256 + column).astype(np.uint16)
