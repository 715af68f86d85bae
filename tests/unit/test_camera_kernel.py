"""What the kernel is fed with, how it is compiled, and what must never be left out."""

from __future__ import annotations

import os
import subprocess
import sys

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.calibration import StereoCalibration, load_calibration
from common.errors import ModelError, UnsupportedGeom
from common.tasks.task import SceneCamera
from services.sim.camera import SceneRenderer, StereoCamera, Tracer
from services.sim.camera.compiled import digest_sources
from services.sim.camera.kernel import render_pictures
from services.sim.camera.lens import MOST_RAYS, Lens, build_lens, build_pinhole
from tests.camera_scene import TOOL_SITE, build_scene

CAMP = """
<mujoco>
  <asset>
    <mesh name="mesh" vertex="0 0 0  1 0 0  0 1 0  0 0 1"/>
    <hfield name="hfield" nrow="2" ncol="2" size="1 1 1 1" elevation="0 0 0 1"/>
  </asset>
  <worldbody>
    <site name="tool"/>
    <body name="camp"><geom name="tent" type="{kind}" {kind}="{kind}" {group}/></body>
  </worldbody>
</mujoco>"""


@pytest.mark.parametrize("kind", ["mesh", "hfield"])
def test_a_visible_geom_without_a_formula_is_refused_by_name(kind: str):
    xml = CAMP.format(kind=kind, group="")
    if kind == "hfield":
        xml = xml.replace('<body name="camp">', "").replace("</body>", "")
    model = mujoco.MjModel.from_xml_string(xml)
    for build in (
        lambda: StereoCamera(model, load_calibration("t265"), tool_site="tool"),
        lambda: SceneRenderer(model, width=8, height=8),
        lambda: Tracer(model),
    ):
        with pytest.raises(UnsupportedGeom) as caught:
            build()
        assert isinstance(caught.value, ModelError)
        assert (caught.value.geom, caught.value.kind) == ("tent", kind)
        assert "capsule" in caught.value.expected
        assert "group 4" in caught.value.action


def test_a_hidden_mesh_does_no_harm():
    model = mujoco.MjModel.from_xml_string(CAMP.format(kind="mesh", group='group="4"'))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    left, right = StereoCamera(model, load_calibration("t265"), tool_site="tool").render(data)
    assert left == right


def assert_tiles_cover(lens: Lens) -> None:
    """Every pixel lies in exactly one tile, and no tile has more rays than there is room for."""
    covered = np.zeros(lens.rays.shape[:2], dtype=int)
    for top, bottom, left, right in lens.tiles.tolist():
        assert (bottom - top) * (right - left) <= MOST_RAYS
        covered[top:bottom, left:right] += 1
    height, width = lens.inside.shape
    assert (covered[:height, :width][lens.inside == 1] == 1).all()
    assert (covered[::2, ::2][: len(lens.coarse)][lens.coarse == 1] == 1).all()
    assert covered.max() == 1


@settings(max_examples=60)
@given(width=st.integers(1, 70), height=st.integers(1, 70))
def test_tiles_of_pinholes_of_any_size_cover_them(width: int, height: int):
    assert_tiles_cover(build_pinhole(width, height, 60.0)._replace(coarse=np.zeros((0, 0))))


@settings(max_examples=30)
@given(
    width=st.integers(2, 70), height=st.integers(2, 70), name=st.sampled_from(["t265", "pinhole"])
)
def test_tiles_of_calibrated_lenses_of_any_size_cover_them(width: int, height: int, name: str):
    fields = load_calibration(name).model_dump()
    fields |= {"width": width, "height": height, "center_px": (width / 2, height / 2)}
    assert_tiles_cover(build_lens(StereoCalibration.model_validate(fields)))


SIZES = ((60, 40), (61, 47), (17, 16), (1, 1))


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_scene_pictures_do_not_depend_on_how_they_are_tiled(width: int, height: int):
    # The middle of a larger picture with the same focal length shows the same pixels.
    model, data = build_scene()
    view = SceneCamera((1.9, -1.3, 1.6), (0.55, -0.1, 0.75), fovy_deg=40.0)
    picture = SceneRenderer(model, width=width, height=height).render(data, view)
    larger = 2.0 * np.degrees(np.arctan((height + 20) / height * np.tan(np.radians(20.0))))
    wide = SceneCamera(view.position_m, view.target_m, fovy_deg=float(larger))
    around = SceneRenderer(model, width=width + 34, height=height + 20).render(data, wide)
    middle = around[10 : 10 + height, 17 : 17 + width].astype(int)
    assert (np.abs(picture - middle) <= 1).mean() > 0.99


def test_pictures_do_not_depend_on_other_cameras_or_earlier_pictures():
    model, data = build_scene()
    cameras = [
        StereoCamera(model, load_calibration(name), tool_site=TOOL_SITE, full_grid=full_grid)
        for name in ("t265", "pinhole")
        for full_grid in (False, True)
    ]
    first = [camera.render(data) for camera in cameras]
    moved = mujoco.MjData(model)
    moved.qpos[:] += np.random.default_rng(0).normal(scale=0.2, size=model.nq)
    mujoco.mj_kinematics(model, moved)
    for camera in reversed(cameras):
        camera.render(moved)
    assert [camera.render(data) for camera in cameras] == first


CACHED = """
import sys
from common.calibration import load_calibration
from services.sim.camera import StereoCamera
from services.sim.camera.kernel import render_pictures
from tests.camera_scene import TOOL_SITE, build_scene

model, data = build_scene()
StereoCamera(model, load_calibration("t265"), tool_site=TOOL_SITE).render(data)
StereoCamera(model, load_calibration("pinhole"), tool_site=TOOL_SITE, full_grid=True).render(data)
print(len(render_pictures.signatures), sum(render_pictures.stats.cache_hits.values()))
"""


def test_a_new_process_takes_the_kernel_from_the_cache():
    model, data = build_scene()
    StereoCamera(model, load_calibration("t265"), tool_site=TOOL_SITE).render(data)
    result = subprocess.run(
        [sys.executable, "-c", CACHED],
        check=True,
        capture_output=True,
        text=True,
        env={**os.environ},
    )
    # One signature serves both lenses and both grids, and it is not compiled again.
    assert result.stdout.split() == ["1", "1"]


def test_the_kernel_knows_which_sources_it_was_compiled_from():
    # Numba itself would not notice a change in a file that the kernel's file only imports.
    camera_version = render_pictures.py_func.__closure__[0].cell_contents
    assert camera_version == digest_sources()
