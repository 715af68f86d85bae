"""Meshes of a robot, for pictures that people look at. Needs MuJoCo (the extra [meshes]).

They are no part of LEGATO: they come from a folder that is laid out as MuJoCo Menagerie is, and
the table [meshes] of robot.toml says where in it. MuJoCo reads the model with its OBJ, STL and PNG
files.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from common.errors import BadMeshes, BadRobotFile
from common.robots.compile import compile_robot
from common.robots.mesh_colors import color_triangles
from common.robots.mesh_fit import check_fit
from common.robots.spec import BodyMeshSpec, MeshesSpec, RobotSpec
from common.se3 import Array, make_pose, matrix_from_quat, pose_from_wire

_MESH = int(mujoco.mjtGeom.mjGEOM_MESH)

_LEAST_AGREEMENT = 0.7
"""Cosine between a triangle's plane and the normals at its corners, below which it is shown flat.

A mesh file may come without normals. MuJoCo then makes one for each vertex, of one of the sides
that meet there: wrong for the others.
"""


@dataclass(frozen=True, eq=False)
class Shell:
    """Triangles that move with one body of the robot.

    Args:
        body: Its name in model.xml.
        corners: (n, 3, 3) the corners of each triangle, in the frame of the body [m].
        normals: (n, 3, 3) outward unit normals there; equal at all three on flat parts.
        colors: (n, 3) red, green, blue from 0 to 1, as a screen shows them in full light.
    """

    body: str
    corners: Array
    normals: Array
    colors: Array


def load_shells(robot: RobotSpec, folder: Path) -> tuple[Shell, ...]:
    """Read a robot's meshes and check that they move as the robot does.

    Args:
        robot: One with a table [meshes].
        folder: A copy of MuJoCo Menagerie, or a folder with the same layout.

    Raises:
        BadMeshes: The robot has no such table; or folder, file, body or joint is missing; or
            something cannot be read or shown.
        MeshesDoNotFit: At equal joint positions a body is not where ours is.
        BadRobotFile: The robot's own files do not agree.
    """
    table = robot.meshes
    if table is None:
        problem = "robot.toml has no table [meshes]"
        raise BadMeshes(robot.name, problem, expected="a robot that has one")
    ours, theirs = compile_robot(robot), _compile(robot.name, table, folder)
    _check_names(robot.name, table, ours, theirs)
    check_fit(robot.name, table, ours, theirs)
    return tuple(_read_shell(robot.name, table, pair, theirs) for pair in table.bodies)


def _compile(robot: str, table: MeshesSpec, folder: Path) -> mujoco.MjModel:
    path = folder / table.file
    if not path.is_file():
        missing = f"file {table.file} in {folder}" if folder.is_dir() else f"folder {folder}"
        raise BadMeshes(robot, f"there is no {missing}", expected="a copy of MuJoCo Menagerie")
    try:
        return mujoco.MjSpec.from_file(str(path)).compile()
    except ValueError as error:
        # MuJoCo spreads its message over lines.
        problem = ", ".join(str(error).removeprefix("Error: ").splitlines())
        raise BadMeshes(robot, f"{path}: {problem}", expected="a model that compiles") from error


def _check_names(
    robot: str, table: MeshesSpec, ours: mujoco.MjModel, theirs: mujoco.MjModel
) -> None:
    """Refuse names that one of the models does not have."""
    body, joint, geom = (
        mujoco.mjtObj.mjOBJ_BODY,
        mujoco.mjtObj.mjOBJ_JOINT,
        mujoco.mjtObj.mjOBJ_GEOM,
    )
    mine = [("body", body, pair.ours) for pair in table.bodies]
    mine += [("geom", geom, name) for name in table.keep]
    for kind, mj_kind, name in mine:
        if mujoco.mj_name2id(ours, mj_kind, name) < 0:
            raise BadRobotFile(robot, "meshes", f"model.xml has no {kind} {name}")
    foreign = [("body", body, pair.theirs) for pair in table.bodies]
    foreign += [("joint", joint, each.joint) for each in table.posture]
    for kind, mj_kind, name in foreign:
        if mujoco.mj_name2id(theirs, mj_kind, name) < 0:
            known = ", ".join(str(theirs.body(b).name) for b in range(1, theirs.nbody))
            problem = f"{table.file} has no {kind} {name}"
            raise BadMeshes(robot, problem, expected=f"the bodies of robot.toml; it has {known}")


def _read_shell(robot: str, table: MeshesSpec, pair: BodyMeshSpec, theirs: mujoco.MjModel) -> Shell:
    geoms = list(_visible_geoms(theirs, pair.theirs, table.group))
    kinds = {int(theirs.geom_type[geom]) for geom in geoms}
    if kinds != {_MESH}:
        names = [mujoco.mjtGeom(k).name.removeprefix("mjGEOM_").lower() for k in sorted(kinds)]
        problem = f"body {pair.theirs} shows {', '.join(names) or 'nothing'}"
        raise BadMeshes(robot, problem, expected=f"meshes, and only meshes, in group {table.group}")
    T_ours_theirs = pose_from_wire(pair.T_ours_theirs)
    parts = [_read_triangles(theirs, geom, T_ours_theirs) for geom in geoms]
    corners, normals, colors = (np.concatenate(rows) for rows in zip(*parts, strict=True))
    return Shell(pair.ours, corners, normals, colors)


def _read_triangles(
    theirs: mujoco.MjModel, geom: int, T_ours_theirs: Array
) -> tuple[Array, Array, Array]:
    """Corners and normals (n, 3, 3) in our body, and colours (n, 3), of one geom."""
    T_theirs_mesh = make_pose(matrix_from_quat(theirs.geom_quat[geom]), theirs.geom_pos[geom])
    T = T_ours_theirs @ T_theirs_mesh
    mesh = int(theirs.geom_dataid[geom])
    start, count = int(theirs.mesh_faceadr[mesh]), int(theirs.mesh_facenum[mesh])
    faces = slice(start, start + count)
    vertex = theirs.mesh_face[faces] + theirs.mesh_vertadr[mesh]
    normal = theirs.mesh_facenormal[faces] + theirs.mesh_normaladr[mesh]
    corners = theirs.mesh_vert[vertex].astype(np.float64) @ T[:3, :3].T + T[:3, 3]
    normals = theirs.mesh_normal[normal].astype(np.float64) @ T[:3, :3].T
    return corners, _flatten(corners, normals), color_triangles(theirs, geom, faces)


def _flatten(corners: Array, normals: Array) -> Array:
    """Normals (n, 3, 3), those of the triangle's plane where the given ones do not belong to it."""
    edges = np.diff(corners, axis=1)
    across = np.cross(edges[:, 0], edges[:, 1])
    # A triangle without area is never met: its direction may be anything.
    plane = across / np.maximum(np.sqrt((across**2).sum(axis=1, keepdims=True)), 1e-300)
    agree = (normals * plane[:, None]).sum(axis=2, keepdims=True) >= _LEAST_AGREEMENT
    return np.where(agree, normals, plane[:, None])


def _visible_geoms(theirs: mujoco.MjModel, body: str, group: int) -> Iterator[int]:
    first, count = int(theirs.body(body).geomadr[0]), int(theirs.body(body).geomnum[0])
    for geom in range(first, first + count):
        if int(theirs.geom_group[geom]) == group:
            yield geom
