"""What colour the triangles of a mesh have: from geom, material or texture."""

from __future__ import annotations

import mujoco
import numpy as np

from common.se3 import Array

_UNSET_RGBA = (0.5, 0.5, 0.5, 1.0)
_RGB_ROLE = int(mujoco.mjtTextureRole.mjTEXROLE_RGB)


def color_triangles(model: mujoco.MjModel, geom: int, faces: slice) -> Array:
    """Red, green, blue from 0 to 1 of the triangles of a mesh, each of one colour.

    A texture is read at the middle of each triangle and multiplied with the material's colour.

    Args:
        model: Compiled.
        geom: One of its geoms of kind mesh.
        faces: The mesh's rows of `mesh_face`.

    Returns:
        (n, 3).
    """
    rgba = model.geom_rgba[geom]
    material = int(model.geom_matid[geom])
    # MuJoCo: a geom's own colour hides its material's.
    if material >= 0 and tuple(rgba.tolist()) == _UNSET_RGBA:
        rgba = model.mat_rgba[material]
    colors = np.tile(rgba[:3].astype(np.float64), (faces.stop - faces.start, 1))
    texture = int(model.mat_texid[material, _RGB_ROLE]) if material >= 0 else -1
    places = int(model.mesh_texcoordadr[int(model.geom_dataid[geom])])
    if texture >= 0 and places >= 0:
        middle = model.mesh_texcoord[model.mesh_facetexcoord[faces] + places].mean(axis=1)
        colors *= _read_texture(model, texture, middle * model.mat_texrepeat[material])
    return colors


def _read_texture(model: mujoco.MjModel, texture: int, places: Array) -> Array:
    """(n, 3) colours at (n, 2) coordinates: u to the right, v down, both repeating at 1."""
    height, width = int(model.tex_height[texture]), int(model.tex_width[texture])
    channels, start = int(model.tex_nchannel[texture]), int(model.tex_adr[texture])
    pixels = model.tex_data[start : start + height * width * channels]
    column = np.floor(places[:, 0] * width).astype(np.int64) % width
    row = np.floor(places[:, 1] * height).astype(np.int64) % height
    found = pixels.reshape(height, width, channels)[row, column] / 255.0
    return found[:, :3] if channels >= 3 else found[:, :1].repeat(3, axis=1)
