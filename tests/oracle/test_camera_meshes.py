"""A mesh of a box is seen, lit, hidden and casts shadows as the box itself is."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from common.calibration import load_calibration
from common.robots import load_robot
from common.robots.meshes import Shell, load_shells
from common.tasks.task import SceneCamera
from services.sim.camera import SceneRenderer, Skin, StereoCamera, Tracer
from services.sim.camera.meshes import pack
from tests.menagerie import PANDA, cube_obj
from tests.mesh_tracer import trace_hull

HALF_M = 0.3
RGB = (0.2, 0.5, 0.8)
VIEW = SceneCamera((1.8, -1.5, 1.4), (0.0, 0.0, 0.3), fovy_deg=45.0)

SCENE = f"""
<mujoco>
  <worldbody>
    <site name="tool" pos="-0.9 -0.6 0.9" euler="0 30 30"/>
    <geom name="floor" type="plane" size="3 3 0.1" rgba="0.6 0.6 0.6 1"/>
    <body name="box" pos="0 0 0.5" euler="20 30 40">
      <geom name="box" type="box" size="{HALF_M} {HALF_M} {HALF_M}" rgba="0.2 0.5 0.8 1"/>
    </body>
    <geom name="before" type="sphere" size="0.2" pos="0.55 -0.45 0.55" rgba="0.9 0.3 0.1 1"/>
    <geom name="behind" type="cylinder" size="0.1 0.8" pos="-0.5 0.7 0.8" rgba="0.1 0.7 0.2 1"/>
    <geom name="above" type="box" size="0.2 0.05 0.02" pos="0.1 -0.35 1.25" rgba="0.9 0.9 0.2 1"/>
  </worldbody>
</mujoco>"""


@pytest.fixture(scope="module")
def scene() -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return model, data


@pytest.fixture(scope="module")
def cube(tmp_path_factory: pytest.TempPathFactory) -> Shell:
    """A cube of the size of the box, read as any mesh is."""
    folder = PANDA.write(tmp_path_factory.mktemp("menagerie"))
    (folder / Path(PANDA.file).parent / "assets" / "cube.obj").write_text(cube_obj(HALF_M))
    return load_shells(load_robot("panda"), folder)[0]


def make_skin(model: mujoco.MjModel, shell: Shell, *, hidden: bool = True) -> Skin:
    hull, _ = pack([shell])
    bodies = np.array([model.body("box").id], dtype=np.int64)
    geoms = np.array([model.geom("box").id] if hidden else [], dtype=np.int64)
    return Skin(hull, np.tile(RGB, (len(shell.corners), 1)), bodies, geoms)


def test_rays_meet_the_cube_where_they_meet_the_box(scene, cube):
    _, data = scene
    alone = mujoco.MjSpec.from_string(SCENE)
    for name in ("floor", "before", "behind", "above"):
        alone.delete(alone.geom(name))
    box = alone.compile()
    placed = mujoco.MjData(box)
    mujoco.mj_kinematics(box, placed)
    random = np.random.default_rng(0)
    origin = np.array([1.1, -0.7, 1.3])
    directions = random.uniform(-0.5, 0.5, (4000, 3)) + (data.body("box").xpos - origin)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    hits = Tracer(box).trace(placed, origin, directions)
    R, p = data.body("box").xmat.reshape(3, 3), data.body("box").xpos
    hull, _ = pack([cube])
    local = np.tile((origin - p) @ R, (len(directions), 1))
    distances, _ = trace_hull(hull, local, directions @ R)
    met = hits.geom >= 0
    assert 1000 < met.sum() < 4000
    # On the very edge of the box one may pass and the other not.
    assert (met != np.isfinite(distances)).sum() <= 2
    met &= np.isfinite(distances)
    np.testing.assert_allclose(distances[met], hits.distance[met], rtol=0, atol=1e-6)


def test_a_picture_with_the_cube_is_the_picture_of_the_box(scene, cube):
    """Sphere before it, cylinder behind it, a shadow on it and its own on the floor."""
    model, data = scene
    for view in (VIEW, SceneCamera((-0.4, 1.9, 0.7), (0.0, 0.0, 0.4), fovy_deg=50.0)):
        plain = SceneRenderer(model, width=160, height=120).render(data, view).astype(int)
        skin = make_skin(model, cube)
        meshed = SceneRenderer(model, width=160, height=120, skin=skin).render(data, view)
        apart = np.abs(plain - meshed.astype(int)).max(axis=2)
        # Pixels whose ray grazes an edge, of the cube or of a shadow.
        assert (apart > 1).sum() < 20
        unlit = SceneRenderer(model, width=160, height=120, skin=make_skin(model, FAR))
        absent = unlit.render(data, view).astype(int)
        assert (np.abs(absent - plain).max(axis=2) > 10).sum() > 1000


FAR = Shell(
    "box",
    np.array([[[90.0, 0.0, 90.0], [91.0, 0.0, 90.0], [90.0, 1.0, 90.0]]]),
    np.ones((1, 3, 3)),
    np.ones((1, 3)),
)
"""Out of every view, so that nothing is in the place of the box."""


@pytest.mark.parametrize(("x", "seen"), [(0.0, "box"), (-0.8, "wall")])
def test_the_nearer_one_is_seen(x: float, seen: str, cube):
    """A wall in the middle; the cube before or behind it."""
    xml = f"""
    <mujoco><worldbody>
      <geom name="wall" type="box" size="0.02 2 2" pos="-0.4 0 0" rgba="1 0 0 1"/>
      <body name="box" pos="{x} 0 0"><geom name="box" size="0.1"/></body>
    </worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    renderer = SceneRenderer(model, width=9, height=9, skin=make_skin(model, cube))
    red, _, blue = renderer.render(data, SceneCamera((3.0, 0.0, 0.0), (0.0, 0.0, 0.0)))[4, 4]
    assert (blue > red) == (seen == "box")


def test_light_follows_the_normals_of_the_corners():
    """A triangle 3 m below the camera, whose three normals differ, against the formula."""
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body name="box"><geom name="box" size="0.1"/></body></worldbody>'
        "</mujoco>"
    )
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    corners = np.array([[-1.0, -1.0, 1.0], [1.0, -1.0, 1.0], [0.0, 1.0, 1.0]])
    normals = np.array([[-0.6, 0.0, 0.8], [0.6, 0.0, 0.8], [0.0, 0.6, 0.8]])
    skin = make_skin(model, Shell("box", corners[None], normals[None], np.ones((1, 3))))
    above = SceneCamera((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), fovy_deg=10.0)
    picture = SceneRenderer(model, width=40, height=40, skin=skin).render(data, above)
    rows, columns = np.indices((40, 40)) + 0.5 - 20.0
    # Straight down, the world's x runs up the picture and y to the left.
    d = np.stack([-rows, -columns, np.full((40, 40), -20.0 / np.tan(np.radians(5.0)))], axis=-1)
    p = np.array(above.position_m) - 3.0 / d[..., 2:] * d
    d /= np.linalg.norm(d, axis=-1, keepdims=True)
    weights = np.linalg.solve(
        np.vstack([corners[:, :2].T, np.ones(3)]), np.insert(p[..., :2], 2, 1.0, axis=-1)[..., None]
    )[..., 0]
    n = weights @ normals
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    to_light = np.array([0.2, -0.8, 2.4]) - p
    to_light /= np.linalg.norm(to_light, axis=-1, keepdims=True)
    factor = 0.3 - 0.3 * (n * d).sum(axis=-1) + 0.55 * np.maximum((n * to_light).sum(axis=-1), 0.0)
    expected = 255.0 * (factor[..., None] * RGB).clip(0.0, 1.0) ** (1.0 / 1.6)
    assert np.ptp(expected[..., 2]) > 10
    assert np.abs(picture - expected).max() < 0.6


def test_both_sides_of_a_triangle_are_seen(scene, cube):
    model, data = scene
    turned = Shell("box", cube.corners[:, ::-1], -cube.normals[:, ::-1], cube.colors)
    pictures = [
        SceneRenderer(model, width=80, height=60, skin=make_skin(model, shell)).render(data, VIEW)
        for shell in (cube, turned)
    ]
    assert np.abs(pictures[0].astype(int) - pictures[1]).max() <= 1


def test_the_eyes_and_the_model_know_nothing_of_meshes(scene, cube):
    model, data = scene
    camera = StereoCamera(model, load_calibration("t265"), tool_site="tool")
    before, groups = camera.render(data), model.geom_group.copy()
    skin = make_skin(model, cube)
    SceneRenderer(model, width=20, height=20, skin=skin).render(data, VIEW)
    assert (model.geom_group == groups).all()
    fresh = StereoCamera(model, load_calibration("t265"), tool_site="tool")
    assert fresh.render(data) == before == camera.render(data)


def test_the_same_state_gives_the_same_bytes(scene, cube):
    model, data = scene
    renderer = SceneRenderer(model, width=60, height=40, skin=make_skin(model, cube))
    first = renderer.render(data, VIEW)
    renderer.render(data, SceneCamera((0.5, 2.0, 1.0), (0.0, 0.0, 0.3)))
    assert np.array_equal(renderer.render(data, VIEW), first)
