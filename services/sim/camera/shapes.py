"""The geoms that a camera may see, as tables for the kernels."""

from __future__ import annotations

from typing import Any, TypeAlias

import mujoco
import numpy as np
import numpy.typing as npt

from common.errors import UnsupportedGeom
from common.se3 import Array
from services.sim.camera.compiled import device, inlined
from services.sim.camera.primitives import BOX, CAPSULE, CYLINDER, ELLIPSOID, PLANE, SPHERE

Integers: TypeAlias = npt.NDArray[np.int64]
Index: TypeAlias = int | np.int64

Table: TypeAlias = Any
"""An array of records, one per shape or surface: type checkers know no fields of records."""

Mask: TypeAlias = npt.NDArray[np.bool_]

HIDDEN_GROUPS = (4, 5)
"""Geom groups that no camera sees: collision shapes and helpers."""

_KINDS = {
    PLANE: "plane",
    SPHERE: "sphere",
    CAPSULE: "capsule",
    ELLIPSOID: "ellipsoid",
    CYLINDER: "cylinder",
    BOX: "box",
}


SHAPE = np.dtype(
    [
        ("geom", np.int64),
        ("kind", np.int64),
        *((name, np.float64) for name in ("sx", "sy", "sz", "radius", "px", "py", "pz")),
        *((f"r{row}{column}", np.float64) for row in range(3) for column in range(3)),
    ]
)
"""One shape: geom id; kind, see `primitives`; size as in MuJoCo [m]; radius of the bounding sphere
about its origin, of planes infinite [m]; origin p [m] and rotation r in the world."""


def drawable_geoms(model: mujoco.MjModel) -> Mask:
    """(ngeom,) True for geoms a camera may see: not in a hidden group and not fully transparent."""
    material = np.where(model.geom_matid < 0, 0, model.geom_matid)
    alpha = np.where(
        model.geom_matid < 0,
        model.geom_rgba[:, 3],
        model.mat_rgba[material, 3] if model.nmat else 0.0,
    )
    return (alpha > 0.0) & ~np.isin(model.geom_group, HIDDEN_GROUPS)


def collect_shapes(model: mujoco.MjModel) -> Table:
    """(g,) `SHAPE` records of all drawable geoms of a model, by rising geom id, not yet placed.

    Raises:
        UnsupportedGeom: One of them is a mesh, a height field or another kind without a formula.
    """
    geom = np.flatnonzero(drawable_geoms(model)).astype(np.int64)
    kind = model.geom_type[geom].astype(np.int64)
    for index, value in zip(geom.tolist(), kind.tolist(), strict=True):
        if value not in _KINDS:
            name = str(model.geom(index).name) or f"number {index}"
            body = str(model.body(int(model.geom_bodyid[index])).name)
            found = mujoco.mjtGeom(value).name.removeprefix("mjGEOM_").lower()
            raise UnsupportedGeom(name, body, found, tuple(_KINDS.values()))
    size = np.array(model.geom_size[geom], dtype=np.float64).reshape(-1, 3)
    shapes = np.zeros(len(geom), dtype=SHAPE)
    shapes["geom"], shapes["kind"] = geom, kind
    shapes["sx"], shapes["sy"], shapes["sz"] = size.T
    shapes["radius"] = _bounding_radius(kind, size)
    return shapes


@device
def place(shapes: Table, geom_xpos: Array, geom_xmat: Array) -> None:
    """Copy the poses of the shapes from `MjData`: geom_xpos (ngeom, 3), geom_xmat (ngeom, 9)."""
    for shape in shapes:
        geom = shape.geom
        shape.px, shape.py, shape.pz = geom_xpos[geom, 0], geom_xpos[geom, 1], geom_xpos[geom, 2]
        shape.r00, shape.r01, shape.r02 = geom_xmat[geom, 0], geom_xmat[geom, 1], geom_xmat[geom, 2]
        shape.r10, shape.r11, shape.r12 = geom_xmat[geom, 3], geom_xmat[geom, 4], geom_xmat[geom, 5]
        shape.r20, shape.r21, shape.r22 = geom_xmat[geom, 6], geom_xmat[geom, 7], geom_xmat[geom, 8]


@inlined
def to_shape(shape: Any, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A world vector in the frame of a shape: R^T (x, y, z)."""
    return (
        shape.r00 * x + shape.r10 * y + shape.r20 * z,
        shape.r01 * x + shape.r11 * y + shape.r21 * z,
        shape.r02 * x + shape.r12 * y + shape.r22 * z,
    )


@inlined
def to_world(shape: Any, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A vector of a shape's frame in the world: R (x, y, z)."""
    return (
        shape.r00 * x + shape.r01 * y + shape.r02 * z,
        shape.r10 * x + shape.r11 * y + shape.r12 * z,
        shape.r20 * x + shape.r21 * y + shape.r22 * z,
    )


def _bounding_radius(kind: Integers, size: Array) -> Array:
    x, y, z = size.T
    diagonal = np.sqrt(x * x + y * y + z * z)
    radius = np.full(len(kind), np.inf)
    for this, value in (
        (SPHERE, x),
        (CAPSULE, x + y),
        (ELLIPSOID, size.max(axis=1, initial=0.0)),
        (CYLINDER, np.sqrt(x * x + y * y)),
        (BOX, diagonal),
    ):
        radius[kind == this] = value[kind == this]
    return radius
