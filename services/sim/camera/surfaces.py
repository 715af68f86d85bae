"""What shapes look like: albedo from the model's colours, and the pattern each of them has."""

from __future__ import annotations

import zlib

import mujoco
import numpy as np

from services.sim.camera.patterns import PLAIN, TOP_CHECKER, find_pattern
from services.sim.camera.shapes import Table

SURFACE = np.dtype(
    [
        *((name, np.float64) for name in ("gray", "red", "green", "blue", "period", "dark")),
        ("pattern", np.int64),
        ("has_top", np.int64),
        ("salt", np.int64),
    ]
)
"""One surface: albedo, of the sky its tint; size of the pattern's parts [m]; albedo of its dark
parts over that of the light ones; kind of the pattern, see `patterns`; 1 if the top face of this
shape is a surface of its own; a number that tells the patterns of geoms apart."""

_GRAY_OF_RGB = (0.299, 0.587, 0.114)
_UNSET_RGBA = (0.5, 0.5, 0.5, 1.0)
_SKY_RGB = (0.93, 0.98, 1.06)


def collect_surfaces(model: mujoco.MjModel, shapes: Table) -> Table:
    """(2 g + 1,) `SURFACE` records of g shapes, from the geoms' colours, materials and names.

    The surface of a hit is the number of the shape, or that number + g on the top face of a shape
    with a checker there. Surface 2 g is the sky.
    """
    count = len(shapes)
    surfaces = np.zeros(2 * count + 1, dtype=SURFACE)
    for number, geom in enumerate(shapes["geom"].tolist()):
        name = str(model.geom(geom).name)
        pattern, salt = find_pattern(name), zlib.crc32(name.encode()) & 0xFFFF
        on_top = pattern.kind == TOP_CHECKER
        red, green, blue = _color(model, geom)
        gray = sum(w * c for w, c in zip(_GRAY_OF_RGB, (red, green, blue), strict=True))
        look = (gray, red, green, blue, pattern.period_m, pattern.dark)
        surfaces[number] = (*look, PLAIN if on_top else pattern.kind, on_top, salt)
        surfaces[number + count] = (*look, pattern.kind, 0, salt)
    surfaces[2 * count] = (1.0, *_SKY_RGB, 1.0, 1.0, PLAIN, 0, 0)
    return surfaces


def _color(model: mujoco.MjModel, geom: int) -> list[float]:
    """A geom's own colour, or its material's where it has none of its own."""
    rgba: list[float] = model.geom_rgba[geom].tolist()
    material = int(model.geom_matid[geom])
    if material >= 0 and tuple(rgba) == _UNSET_RGBA:
        rgba = model.mat_rgba[material].tolist()
    return rgba[:3]
