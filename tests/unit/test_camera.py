"""Orientation, visibility, shadows, patterns and determinism of the ray-traced cameras."""

from __future__ import annotations

import hashlib
import subprocess
import sys

import mujoco
import numpy as np
import pytest

from common.calibration import load_calibration
from common.errors import InvalidValue, UnknownName
from common.tasks.task import SceneCamera
from services.sim.camera import SceneRenderer, StereoCamera, Tracer
from tests.camera_scene import TOOL_SITE, build_scene

NAMES = ("t265", "pinhole")


def build(geoms: str, *, tool: str = "0 0 1") -> tuple[mujoco.MjModel, mujoco.MjData]:
    xml = f"""
    <mujoco>
      <asset><material name="red" rgba="1 0 0 1"/></asset>
      <worldbody><site name="tool" pos="{tool}"/>{geoms}</worldbody>
    </mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return model, data


def render(model, data, name: str = "t265", **options) -> np.ndarray:
    calibration = load_calibration(name)
    camera = StereoCamera(model, calibration, tool_site="tool", **options)
    return np.frombuffer(b"".join(camera.render(data)), dtype=np.uint8).reshape(2, 128, 128)


def middle_of_dark(picture: np.ndarray) -> tuple[float, float]:
    """Mean image row and column of the black pixels well inside the image circle."""
    rows, columns = np.nonzero(picture[24:104, 24:104] == 0)
    assert rows.size > 10
    return 24.5 + float(rows.mean()), 24.5 + float(columns.mean())


def ball(x: float, y: float, z: float) -> str:
    return f'<geom type="sphere" size="0.06" pos="{x} {y} {z}" rgba="0 0 0 1"/>'


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("full_grid", [False, True])
def test_left_is_left_and_up_is_up(name: str, full_grid: bool):
    left_and_up = render(*build(ball(0.6, 0.2, 1.25)), name, full_grid=full_grid)
    for picture in left_and_up:
        row, column = middle_of_dark(picture)
        assert row < 60.0
        assert column < 60.0


@pytest.mark.parametrize("name", NAMES)
def test_the_left_eye_sees_things_further_right(name: str):
    left, right = render(*build(ball(0.5, 0.0, 1.05)), name)
    (row_left, column_left), (row_right, column_right) = map(middle_of_dark, (left, right))
    assert column_left > 64.0 > column_right
    # Mirror images of each other, as the ball lies half-way between the eyes.
    assert column_left - 64.0 == pytest.approx(64.0 - column_right, abs=0.5)
    assert row_left == pytest.approx(row_right, abs=0.2)


def test_pictures_turn_with_the_tool():
    # The tool is rolled to the left: what is above appears to the right.
    model, data = build(
        '<body euler="-90 0 0" pos="0 0 1"><site name="rolled"/></body>' + ball(0.6, 0.0, 1.25)
    )
    camera = StereoCamera(model, load_calibration("t265"), tool_site="rolled")
    left, _ = camera.render(data)
    row, column = middle_of_dark(np.frombuffer(left, dtype=np.uint8).reshape(128, 128))
    assert column > 68.0
    assert row == pytest.approx(64.0, abs=6.0)


def test_outside_the_image_circle_everything_is_black():
    outside = load_calibration("t265").outside_circle()
    for full_grid in (False, True):
        pictures = render(*build(""), full_grid=full_grid)
        assert (pictures[:, outside] == 0).all()
        assert (pictures[:, ~outside] > 0).all()


@pytest.mark.parametrize("hidden", ['group="4"', 'group="5"', 'rgba="1 1 1 0"'])
def test_hidden_geoms_are_neither_seen_nor_cast_shadows(hidden: str):
    floor = '<geom name="ground" type="plane" size="0 0 1"/>'
    helper = f'<geom type="box" size="0.2 0.2 0.02" pos="0.5 0 0.9" {hidden}/>'
    assert np.array_equal(render(*build(floor)), render(*build(floor + helper)))


def test_a_transparent_material_hides_a_geom():
    model, data = build('<geom type="sphere" size="0.2" pos="0.6 0 1" material="red"/>')
    seen = Tracer(model).trace(data, np.array([0.0, 0.0, 1.0]), np.array([[1.0, 0.0, 0.0]]))
    assert seen.distance.tolist() == pytest.approx([0.4])
    model.mat_rgba[0, 3] = 0.0
    unseen = Tracer(model).trace(data, np.array([0.0, 0.0, 1.0]), np.array([[1.0, 0.0, 0.0]]))
    assert unseen.geom.tolist() == [-1]


@pytest.mark.parametrize("full_grid", [False, True])
def test_a_shadow_falls_away_from_the_light(full_grid: bool):
    # The light is at (0.2, -0.8, 2.4): a plate 0.5 above the ground shades a patch at its far side.
    geoms = (
        '<geom name="ground" type="plane" size="0 0 1"/>'
        '<geom type="box" size="0.1 0.1 0.01" pos="0.8 0 0.5"/>'
    )
    model, data = build(geoms, tool="0 0 1")
    lit, shaded = (
        render(model, data, "pinhole", full_grid=full_grid, shadows=shadows)
        for shadows in (False, True)
    )
    darker = lit.astype(int) - shaded
    assert (darker >= 0).all()
    light, plate = np.array([0.2, -0.8, 2.4]), np.array([0.8, 0.0, 0.5])
    center = light + (plate - light) * 2.4 / 1.9
    calibration = load_calibration("pinhole")
    eye = np.array([0.0, 0.0, 1.0]) + calibration.p_tool_left_m
    ray = center - eye
    column, row = calibration.project(np.array([-ray[1], -ray[2], ray[0]]))
    assert darker[0, int(row), int(column)] > 20
    assert (darker[0] > 20).sum() < 700


def test_nothing_shades_itself_where_the_light_reaches():
    geoms = (
        '<geom name="ground" type="plane" size="0 0 1"/>'
        '<geom type="cylinder" size="0.2 0.05" pos="0.7 -0.1 0.05"/>'
    )
    model, data = build(geoms)
    top = Tracer(model).trace(data, np.array([0.7, -0.1, 1.0]), np.array([[0.0, 0.0, -1.0]]))
    assert top.distance[0] == pytest.approx(0.9)
    pictures = [render(model, data, "pinhole", shadows=shadows) for shadows in (False, True)]
    column, row = load_calibration("pinhole").project(np.array([0.132, 0.9525, 0.64]))
    window = (slice(int(row) - 3, int(row) + 3), slice(int(column) - 3, int(column) + 3))
    assert np.array_equal(pictures[0][0][window], pictures[1][0][window])


def test_floors_and_tables_are_checkered_and_other_things_are_not():
    plain, checkered = (
        render(*build(f'<geom name="{name}" type="plane" size="0 0 1"/>', tool="0 0 0.6"))
        for name in ("ground", "floor")
    )
    below = (slice(90, 110), slice(40, 88))
    assert np.ptp(checkered[0][below].astype(int)) > 20
    assert np.ptp(plain[0][below].astype(int)) < 20


def test_an_unknown_tool_site_is_named():
    model, _ = build("")
    with pytest.raises(UnknownName) as caught:
        StereoCamera(model, load_calibration("t265"), tool_site="tol")
    assert caught.value.suggestion == "tool"


def test_nothing_is_left_of_earlier_pictures():
    model, data = build_scene()
    camera = StereoCamera(model, load_calibration("t265"), tool_site=TOOL_SITE)
    first = camera.render(data)
    moved = mujoco.MjData(model)
    moved.qpos[:3] += 0.3
    moved.qpos[-7:-4] -= 0.2
    mujoco.mj_kinematics(model, moved)
    assert camera.render(moved) != first
    assert camera.render(data) == first
    fresh = StereoCamera(model, load_calibration("t265"), tool_site=TOOL_SITE)
    assert fresh.render(data) == first


HASHES = """
import hashlib
import numpy as np
from common.calibration import load_calibration
from common.tasks.task import SceneCamera
from services.sim.camera import SceneRenderer, StereoCamera
from tests.camera_scene import TOOL_SITE, build_scene

padding = [np.ones({padding}) for _ in range({padding} % 7)]
model, data = build_scene()
digest = hashlib.sha256()
for name in ("t265", "pinhole"):
    for full_grid in (False, True):
        camera = StereoCamera(
            model, load_calibration(name), tool_site=TOOL_SITE, full_grid=full_grid
        )
        digest.update(b"".join(camera.render(data)))
view = SceneCamera((1.9, -1.3, 1.6), (0.55, -0.1, 0.75))
digest.update(SceneRenderer(model, width=60, height=40).render(data, view).tobytes())
print(digest.hexdigest())
"""


def test_two_processes_render_the_same_bytes():
    digests = {
        subprocess.run(
            [sys.executable, "-c", HASHES.format(padding=padding)],
            check=True,
            capture_output=True,
            text=True,
        ).stdout
        for padding in (1001, 77773)
    }
    assert len(digests) == 1
    assert len(digests.pop().strip()) == hashlib.sha256().digest_size * 2


VIEW = SceneCamera((0.0, -2.0, 1.0), (0.0, 0.0, 1.0), fovy_deg=40.0)


def test_scene_pictures_are_upright_and_in_colour():
    model, data = build(
        '<geom type="sphere" size="0.15" pos="0.4 0 1.3" rgba="1 0 0 1"/>'
        '<geom type="sphere" size="0.15" pos="-0.4 0 0.7" rgba="0 0 1 1"/>'
    )
    picture = SceneRenderer(model, width=90, height=60).render(data, VIEW).astype(int)
    assert picture.shape == (60, 90, 3)
    reds = np.argwhere(picture[..., 0] - picture[..., 2] > 60)
    blues = np.argwhere(picture[..., 2] - picture[..., 0] > 60)
    # Seen from -y: +x is to the right.
    assert reds.mean(axis=0)[0] < 25 < 35 < blues.mean(axis=0)[0]
    assert blues.mean(axis=0)[1] < 40 < 50 < reds.mean(axis=0)[1]


def test_supersampling_softens_edges_only():
    model, data = build('<geom type="sphere" size="0.3" pos="0 0 1" rgba="0 0 0 1"/>')
    plain = SceneRenderer(model, width=60, height=40).render(data, VIEW)
    smooth = SceneRenderer(model, width=60, height=40, supersample=2).render(data, VIEW)
    assert smooth.shape == plain.shape
    assert np.abs(smooth[:5].astype(int) - plain[:5]).max() <= 1
    assert len(np.unique(smooth[20])) > len(np.unique(plain[20]))


def test_a_material_colours_a_geom_without_colour_of_its_own():
    model, data = build('<geom type="sphere" size="0.5" pos="0 0 1" material="red"/>')
    picture = SceneRenderer(model, width=20, height=20).render(data, VIEW)
    red, green, _ = picture[10, 10]
    assert red > 100
    assert green == 0


def test_a_renderer_can_change_its_view():
    model, data = build(ball(0.0, 0.0, 1.0))
    renderer = SceneRenderer(model, width=20, height=20)
    wide = SceneCamera(VIEW.position_m, VIEW.target_m, fovy_deg=80.0)
    near, far = (int((renderer.render(data, v) == 0).sum()) for v in (VIEW, wide))
    assert near > far
    from_above = SceneCamera((0.0, 0.0, 2.0), (0.0, 0.0, 1.0))
    assert (renderer.render(data, from_above)[10, 10] == 0).all()


def test_impossible_pictures_are_refused():
    model, data = build("")
    with pytest.raises(InvalidValue):
        SceneRenderer(model, width=0, height=10)
    with pytest.raises(InvalidValue):
        SceneRenderer(model, width=8, height=8).render(data, SceneCamera((0, 0, 1), (0, 0, 1)))
