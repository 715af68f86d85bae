"""Meshes are read from a folder like Menagerie, or refused with what is wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from common.errors import BadMeshes, BadRobotFile, MeshesDoNotFit
from common.robots import MeshesSpec, RobotSpec, list_robots, load_robot
from common.robots.meshes import load_shells
from tests.menagerie import FOREIGN, GOOGLE, HALF_M, PANDA, Foreign


def with_table(robot: str, **fields: object) -> RobotSpec:
    spec = load_robot(robot)
    assert spec.meshes is not None
    return spec.model_copy(update={"meshes": spec.meshes.model_copy(update=fields)})


def refused(foreign: Foreign, folder: Path, *, robot: str = "panda") -> BadMeshes:
    with pytest.raises(BadMeshes) as caught:
        load_shells(load_robot(robot), foreign.write(folder))
    return caught.value


@pytest.mark.parametrize("robot", sorted(FOREIGN))
def test_the_table_names_what_the_model_has_and_its_bodies_move_alike(robot: str, tmp_path):
    spec = load_robot(robot)
    shells = load_shells(spec, FOREIGN[robot].write(tmp_path))
    assert [shell.body for shell in shells] == [pair.ours for pair in spec.meshes.bodies]
    for shell in shells:
        assert shell.corners.shape == shell.normals.shape == (12, 3, 3)
        np.testing.assert_allclose(np.abs(shell.corners), HALF_M, atol=1e-8)
        np.testing.assert_allclose(shell.colors, 0.9, atol=1e-6)


def test_only_the_hand_alone_has_no_meshes():
    assert [name for name in list_robots() if load_robot(name).meshes is None] == ["abstract"]


def test_normals_point_outward(tmp_path):
    (shell, *_) = load_shells(load_robot("panda"), PANDA.write(tmp_path))
    edges = np.diff(shell.corners, axis=1)
    across = np.cross(edges[:, 0], edges[:, 1])
    assert (np.einsum("nk,nk->n", across, shell.corners.mean(axis=1)) > 0.0).all()
    assert (np.einsum("nk,njk->nj", across, shell.normals) > 0.0).all()
    np.testing.assert_allclose(np.linalg.norm(shell.normals, axis=2), 1.0, atol=1e-6)


def test_a_robot_without_a_table_is_refused(tmp_path):
    with pytest.raises(BadMeshes, match=r"abstract: robot\.toml has no table \[meshes\]"):
        load_shells(load_robot("abstract"), tmp_path)


def test_a_missing_folder_or_file_is_named(tmp_path):
    with pytest.raises(BadMeshes, match=f"no folder {tmp_path}/nowhere"):
        load_shells(load_robot("panda"), tmp_path / "nowhere")
    with pytest.raises(
        BadMeshes, match=f"no file franka_emika_panda/panda_nohand.xml in {tmp_path}"
    ):
        load_shells(load_robot("panda"), tmp_path)


def test_a_missing_mesh_file_is_named(tmp_path):
    PANDA.write(tmp_path)
    (tmp_path / "franka_emika_panda" / "assets" / "cube.obj").unlink()
    with pytest.raises(BadMeshes, match=r"cube\.obj"):
        load_shells(load_robot("panda"), tmp_path)


def test_a_missing_body_is_named_with_those_there_are(tmp_path):
    links = PANDA.links[:-1]
    error = refused(Foreign(PANDA.file, links), tmp_path)
    assert "no body link7" in error.happened
    assert "link5, link6" in error.expected


def test_a_missing_joint_of_the_posture_is_named(tmp_path):
    foreign = FOREIGN["gr1"].changed("l_thigh_pitch", joint="other")
    assert "no joint l_leg_hip_pitch" in refused(foreign, tmp_path, robot="gr1").happened


@pytest.mark.parametrize(
    ("geoms", "shown"),
    [
        ('<geom type="box" size="0.1 0.1 0.1" group="2"/>', "shows box"),
        ('<geom class="visual" group="3"/>', "shows nothing"),
        ('<geom class="visual"/><geom type="sphere" size="0.1" group="2"/>', "shows sphere, mesh"),
    ],
)
def test_a_body_that_would_be_lost_is_refused(geoms: str, shown: str, tmp_path):
    error = refused(PANDA.changed("link3", geoms=geoms), tmp_path)
    assert f"body link3 {shown}" in error.happened


@pytest.mark.parametrize(
    ("foreign", "body"),
    [
        (PANDA.changed("link4", pos="0.0875 0 0"), "link4"),
        (PANDA.changed("link5", quat="1 1 0 0"), "link5"),
        (PANDA.changed("link6", axis="0 0 -1"), "link6"),
        (PANDA.changed("link7", joint=""), "link7"),
    ],
)
def test_a_model_that_moves_otherwise_is_refused(foreign: Foreign, body: str, tmp_path):
    with pytest.raises(MeshesDoNotFit, match=f"body {body} is") as caught:
        load_shells(load_robot("panda"), foreign.write(tmp_path))
    assert caught.value.apart_m > 3e-3 or caught.value.apart_rad > 0.02


def test_the_difference_is_told(tmp_path):
    foreign = PANDA.changed("link1", pos="0 0.004 0.333")
    with pytest.raises(MeshesDoNotFit, match=r"link1 is 4\.0 mm and 0\.000 rad away"):
        load_shells(load_robot("panda"), foreign.write(tmp_path))
    load_shells(load_robot("panda"), PANDA.changed("link1", pos="0 0.002 0.333").write(tmp_path))


def test_a_wrong_fixed_posture_is_found(tmp_path):
    spec = with_table("gr1", posture=())
    with pytest.raises(MeshesDoNotFit, match="body l_thigh_pitch"):
        load_shells(spec, FOREIGN["gr1"].write(tmp_path))


def test_a_frame_that_differs_is_turned_back(tmp_path):
    """Their last link is turned by a quarter about z and moved by 5 cm along it."""
    foreign = PANDA.changed(
        "link7",
        pos="0.088 -0.05 0",
        quat="0.5 0.5 -0.5 0.5",
        geoms='<geom class="visual" pos="0.1 0 0"/>',
    )
    spec = load_robot("panda")
    pairs = [pair.model_dump() for pair in spec.meshes.bodies]
    half = 0.5**0.5
    pairs[-1]["T_ours_theirs"] = (0.0, 0.0, 0.05, half, 0.0, 0.0, half)
    table = MeshesSpec.model_validate(spec.meshes.model_dump() | {"bodies": pairs})
    spec = spec.model_copy(update={"meshes": table})
    shell = load_shells(spec, foreign.write(tmp_path))[-1]
    np.testing.assert_allclose(shell.corners.mean(axis=(0, 1)), [0.0, 0.1, 0.05], atol=1e-8)


def test_a_geom_to_keep_that_does_not_exist_is_refused(tmp_path):
    with pytest.raises(BadRobotFile, match="no geom roof"):
        load_shells(with_table("panda", keep=("roof",)), PANDA.write(tmp_path))


def test_a_table_pairs_at_least_one_body():
    with pytest.raises(ValueError, match="at least 1"):
        MeshesSpec(file="robot.xml", bodies=())


def test_colours_come_from_geom_or_material(tmp_path):
    geoms = '<geom class="visual" rgba="1 0.5 0 1"/><geom class="visual"/>'
    shell = load_shells(load_robot("panda"), PANDA.changed("link0", geoms=geoms).write(tmp_path))[0]
    np.testing.assert_allclose(shell.colors[:12], np.tile([1.0, 0.5, 0.0], (12, 1)))
    np.testing.assert_allclose(shell.colors[12:], 0.9, atol=1e-6)


TEXTURED = """
v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1
vt 0.1 0.9\nvt 0.9 0.1
f 1/1 3/1 2/1\nf 1/1 2/1 4/1\nf 2/2 3/2 4/2\nf 1/2 4/2 3/2
"""


def test_colours_come_from_a_texture(tmp_path):
    """Wavefront's v runs upwards: 0.9 is near the top row of the picture."""
    GOOGLE.write(tmp_path)
    folder = tmp_path / "google_robot"
    (folder / "assets" / "cube.obj").write_text(TEXTURED)
    pixels = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 255]]], np.uint8)
    Image.fromarray(pixels).save(folder / "assets" / "paint.png")
    paint = (
        '<texture type="2d" name="paint" file="paint.png"/><material name="white" texture="paint"/>'
    )
    model = folder / "robot.xml"
    model.write_text(
        model.read_text().replace('<material name="white" rgba="0.9 0.9 0.9 1"/>', paint)
    )
    colors = load_shells(load_robot("google"), tmp_path)[0].colors
    np.testing.assert_allclose(colors, [[1, 0, 0], [1, 0, 0], [1, 1, 1], [1, 1, 1]])
