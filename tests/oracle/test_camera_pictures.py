"""Whole pictures against ones made from MuJoCo's rays and the lighting formula, without culling."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from common.calibration import R_TOOL_CAMERA, StereoCalibration, load_calibration
from services.sim.camera import StereoCamera
from tests.camera_scene import TOOL_SITE, scene_xml

LIGHT = np.array([0.2, -0.8, 2.4])
SEEN_GROUPS = np.array([1, 1, 1, 1, 0, 0], dtype=np.uint8)
KINDS = ("sphere", "capsule", "ellipsoid", "cylinder", "box")


def shoot(
    model: mujoco.MjModel, data: mujoco.MjData, origin: np.ndarray, rays: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Geoms, distances and normals of the first hits with all geoms, by MuJoCo."""
    count = len(rays)
    geom, distance = np.full(count, -1, dtype=np.int32), np.full(count, -1.0)
    normal = np.zeros(3 * count)
    vectors = np.ascontiguousarray(rays).ravel()
    mujoco.mj_multiRay(
        model, data, origin, vectors, SEEN_GROUPS, True, -1, geom, distance, normal, count, 1e10
    )
    return geom, distance, normal.reshape(-1, 3)


def draw(
    model: mujoco.MjModel, data: mujoco.MjData, calibration: StereoCalibration, eye: int
) -> np.ndarray:
    """(height, width) grey levels, not rounded."""
    R_world_tool = data.site(TOOL_SITE).xmat.reshape(3, 3)
    p_tool_eye = np.array((calibration.p_tool_left_m, calibration.p_tool_right_m)[eye])
    origin = data.site(TOOL_SITE).xpos + R_world_tool @ p_tool_eye
    rays = calibration.pixel_directions().reshape(-1, 3) @ (R_world_tool @ R_TOOL_CAMERA).T
    geom, distance, normal = shoot(model, data, origin, rays)
    to_point = origin + distance[:, None] * rays - LIGHT
    range_m = np.linalg.norm(to_point, axis=1)
    first, at, _ = shoot(model, data, LIGHT, to_point)
    lit = (first < 0) | (at >= 1.0 - 3e-3 / range_m)
    facing = np.maximum(0.0, -(normal * rays).sum(axis=1))
    lambert = np.maximum(0.0, -(normal * to_point).sum(axis=1) / range_m)
    albedo = model.geom_rgba[geom, :3] @ [0.299, 0.587, 0.114]
    intensity = albedo * (0.30 + 0.30 * facing + 0.55 * lit * lambert)
    intensity = np.where(geom < 0, 0.6 + 0.3 * rays[:, 2], intensity)
    levels = 255.0 * np.clip(intensity, 0.0, 1.0) ** (1 / 1.6)
    height, width = calibration.height, calibration.width
    return np.where(calibration.outside_circle(), 0.0, levels.reshape(height, width))


def assert_same_pictures(
    model: mujoco.MjModel, data: mujoco.MjData, calibration: StereoCalibration
) -> None:
    camera = StereoCamera(model, calibration, tool_site=TOOL_SITE, full_grid=True)
    for eye, picture in enumerate(camera.render(data)):
        shown = np.frombuffer(picture, dtype=np.uint8).reshape(calibration.height, -1)
        wrong = np.abs(shown - draw(model, data, calibration, eye)) > 1.0
        assert wrong.mean() < 1e-3


def scatter(seed: int) -> str:
    """A room with 40 shapes of all kinds, some of them above the light, one around the eyes."""
    random = np.random.default_rng(seed)
    shapes = ['<geom type="plane" size="3 2 1"/>', '<geom type="ellipsoid" size="4 5 6"/>']
    for kind in KINDS * 8:
        size = " ".join(str(value) for value in random.uniform(0.02, 0.4, size=3))
        pos = " ".join(str(v) for v in random.uniform([-2.5, -2.0, 0.0], [2.5, 2.0, 3.5]))
        quat = " ".join(str(value) for value in random.normal(size=4))
        rgba = " ".join(str(value) for value in random.uniform(0.1, 1.0, size=3)) + " 1"
        shapes.append(
            f'<geom type="{kind}" size="{size}" pos="{pos}" quat="{quat}" rgba="{rgba}"/>'
        )
    quat = " ".join(str(value) for value in random.normal(size=4))
    shapes.append(f'<site name="{TOOL_SITE}" pos="0.3 0.2 1.1" quat="{quat}"/>')
    return f"<mujoco><worldbody>{''.join(shapes)}</worldbody></mujoco>"


@pytest.mark.parametrize("name", ["t265", "pinhole"])
@pytest.mark.parametrize("seed", range(4))
def test_pictures_of_scattered_shapes_are_what_unculled_rays_see(name: str, seed: int):
    model = mujoco.MjModel.from_xml_string(scatter(seed))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    assert_same_pictures(model, data, load_calibration(name))


def test_a_lens_that_sees_almost_all_around_loses_nothing():
    # 8 x 8 pixels: one tile spans more than any pyramid can.
    t265 = load_calibration("t265")
    fields = t265.model_dump() | {"width": 8, "height": 8, "center_px": (4.0, 4.0)}
    fields["lens"] |= {"focal": 1.4, "k": (0.0, 0.0, 0.0, 0.0), "max_angle_deg": 170.0}
    calibration = StereoCalibration.model_validate(fields)
    model = mujoco.MjModel.from_xml_string(scatter(5))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    camera = StereoCamera(model, calibration, tool_site=TOOL_SITE, full_grid=True)
    shown = np.frombuffer(camera.render(data)[0], dtype=np.uint8).reshape(8, 8)
    assert np.abs(shown - draw(model, data, calibration, 0)).max() <= 1.0


@pytest.mark.parametrize("name", ["t265", "pinhole"])
def test_a_picture_of_the_lid_task_is_what_unculled_rays_see(name: str):
    # Names decide on patterns, which the formula does not have.
    xml = scene_xml().replace('name="floor"', "").replace('name="table"', "")
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert_same_pictures(model, data, load_calibration(name))
