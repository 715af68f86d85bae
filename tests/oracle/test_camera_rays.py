"""Ray-traced pictures against closed forms, MuJoCo's single rays and the full grid."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from common.calibration import R_TOOL_CAMERA, StereoCalibration, load_calibration
from services.sim.camera import StereoCamera, Tracer
from services.sim.camera.bundles import bound_directions, order_by_tile
from services.sim.camera.culling import Bounds
from tests.camera_scene import TOOL_SITE, build_scene

EYE = np.array([0.0, 0.0, 1.0])
LIGHT = np.array([0.2, -0.8, 2.4])


def build(geoms: str, *, tool: str = "0 0 1") -> tuple[mujoco.MjModel, mujoco.MjData]:
    xml = f'<mujoco><worldbody><site name="tool" pos="{tool}"/>{geoms}</worldbody></mujoco>'
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return model, data


def pictures(camera: StereoCamera, data: mujoco.MjData) -> np.ndarray:
    return np.frombuffer(b"".join(camera.render(data)), dtype=np.uint8).reshape(2, 128, 128)


def random_rays(count: int) -> np.ndarray:
    rays = np.random.default_rng(1).normal(size=(count, 3))
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def test_depth_of_a_sphere_is_the_closed_form():
    center, radius = np.array([0.8, 0.1, 1.2]), 0.3
    model, data = build('<geom type="sphere" size="0.3" pos="0.8 0.1 1.2"/>')
    rays = random_rays(2000)
    hits = Tracer(model).trace(data, EYE, rays)
    along = rays @ (center - EYE)
    across = np.sum((center - EYE) ** 2) - along**2
    is_hit = (across < radius**2) & (along > 0.0)
    assert is_hit.sum() > 50
    assert np.array_equal(hits.geom >= 0, is_hit)
    expected = along[is_hit] - np.sqrt(radius**2 - across[is_hit])
    assert np.abs(hits.distance[is_hit] - expected).max() < 1e-9
    points = EYE + expected[:, None] * rays[is_hit]
    assert np.abs(hits.normal[is_hit] - (points - center) / radius).max() < 1e-9
    assert (hits.distance[~is_hit] == -1.0).all()


def test_depth_of_a_plane_is_the_closed_form():
    model, data = build('<geom type="plane" size="0 0 1" euler="10 20 0" pos="0 0 0.1"/>')
    normal = data.geom_xmat[0].reshape(3, 3)[:, 2]
    rays = random_rays(2000)
    hits = Tracer(model).trace(data, EYE, rays)
    down = rays @ normal < 0.0
    expected = normal @ (np.array([0.0, 0.0, 0.1]) - EYE) / (rays[down] @ normal)
    assert np.array_equal(hits.geom == 0, down)
    assert np.abs(hits.distance[down] / expected - 1.0).max() < 1e-9


def test_bundles_meet_what_single_unculled_rays_meet():
    model, data = build_scene()
    tracer, bounds = Tracer(model), Bounds(model)
    rows, columns = np.divmod(np.arange(100 * 100), 100)
    order, tile = order_by_tile(columns, rows, tile_px=20)
    angle_x, angle_y = (columns[order] - 49.5) * 0.028, (rows[order] - 49.5) * 0.028
    rays = np.stack([np.sin(angle_x), np.sin(angle_y), np.cos(angle_x) * np.cos(angle_y)], axis=1)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    starts = np.append(np.flatnonzero(np.diff(tile, prepend=-1)), len(rays))
    tangents = bound_directions(rays, starts)
    groups, found = np.array([1, 1, 1, 1, 0, 0], dtype=np.uint8), np.zeros(1, dtype=np.int32)
    random = np.random.default_rng(3)
    for _ in range(6):
        R = np.linalg.qr(random.normal(size=(3, 3)))[0]
        origin = random.uniform([0.2, -0.6, 0.3], [1.2, 0.6, 1.6])
        candidates = bounds.place(data).in_pyramids(
            tangents.normals() @ R.T, tangents.corners() @ R.T, apexes=origin[None]
        )
        directions = rays @ R.T
        hits = tracer.trace_bundles(
            data,
            origins=np.tile(origin, (len(starts) - 1, 1)),
            directions=directions,
            starts=starts,
            candidates=candidates,
        )
        assert candidates.mean() < 0.5
        for k in range(0, len(rays), 7):
            distance = mujoco.mj_ray(model, data, origin, directions[k], groups, True, -1, found)
            assert (hits.geom[k], hits.distance[k]) == (found[0], distance)


def outline(mask: np.ndarray, row: int) -> tuple[int, int]:
    """First and one past the last column of a mask's row."""
    columns = np.flatnonzero(mask[row])
    return int(columns[0]), int(columns[-1]) + 1


@pytest.mark.parametrize("name", ["t265", "pinhole"])
@pytest.mark.parametrize("eye", [0, 1])
def test_edges_of_a_box_lie_where_they_project(name: str, eye: int):
    calibration = load_calibration(name)
    # One face of the box stands across the view at x = 0.6, y from -0.2 to 0.3, z from 0.8 to 1.2.
    model, data = build('<geom type="box" size="0.1 0.25 0.2" pos="0.7 0.05 1.0" rgba="0 0 0 1"/>')
    camera = StereoCamera(model, calibration, tool_site="tool", full_grid=True)
    dark = (pictures(camera, data)[eye] == 0) & ~calibration.outside_circle()
    for row in (56, 64, 76):
        left, right = outline(dark, row)
        for y, column in ((0.3, left), (-0.2, right)):
            assert column == pytest.approx(edge_column(calibration, eye, y, row), abs=0.5)


def edge_column(calibration: StereoCalibration, eye: int, y: float, row: int) -> float:
    """Column at which the vertical edge x = 0.6, y of a box crosses the middle of a pixel row."""
    p_tool_eye = np.array((calibration.p_tool_left_m, calibration.p_tool_right_m)[eye])
    z = np.linspace(0.8, 1.2, 4001)
    points = np.stack([np.full_like(z, 0.6), np.full_like(z, y), z - 1.0], axis=1) - p_tool_eye
    projected = calibration.project(points @ R_TOOL_CAMERA)
    return float(projected[np.argmin(np.abs(projected[:, 1] - (row + 0.5))), 0])


@pytest.mark.parametrize("name", ["t265", "pinhole"])
def test_outline_of_a_sphere_lies_where_it_projects(name: str):
    calibration = load_calibration(name)
    center, radius = np.array([0.56, 0.032, 0.0525]), 0.2
    model, data = build(
        '<geom type="sphere" size="0.2" pos="0.56 0.032 1.0525" rgba="0 0 0 1"/>', tool="0 0 1"
    )
    camera = StereoCamera(model, calibration, tool_site="tool", full_grid=True)
    dark = (pictures(camera, data) == 0) & ~calibration.outside_circle()
    # Straight ahead of the left eye: a circle about the centre at asin(radius / distance).
    angle = math.asin(radius / 0.5)
    edge, _ = calibration.project(np.array([math.sin(angle), 0.0, math.cos(angle)]))
    left, right = outline(dark[0], 63)
    assert right == pytest.approx(edge, abs=0.5)
    assert left == pytest.approx(128.0 - edge, abs=0.5)
    # From the right eye: every dark pixel's ray meets the sphere, no bright one's does.
    rays = calibration.pixel_directions() @ R_TOOL_CAMERA.T
    offset = center - np.array(calibration.p_tool_right_m)
    meets = rays @ offset > math.sqrt(offset @ offset - radius**2)
    assert np.array_equal(dark[1], meets & ~calibration.outside_circle())


def test_intensity_is_the_formula():
    model, data = build(
        '<geom type="box" size="0.01 2 2" pos="1 0 1" rgba="0.8 0.4 0.2 1"/>', tool="0 0 1"
    )
    calibration = load_calibration("pinhole")
    left = pictures(StereoCamera(model, calibration, tool_site="tool"), data)[0]
    for row, column in ((64, 64), (30, 90), (100, 20)):
        ray = R_TOOL_CAMERA @ calibration.pixel_directions()[row, column]
        eye = np.array([0.0, 0.0, 1.0]) + calibration.p_tool_left_m
        point = eye + ray * (0.99 - eye[0]) / ray[0]
        to_light = (LIGHT - point) / np.linalg.norm(LIGHT - point)
        albedo = 0.299 * 0.8 + 0.587 * 0.4 + 0.114 * 0.2
        intensity = albedo * (0.30 + 0.30 * ray[0] + 0.55 * max(0.0, -to_light[0]))
        assert left[row, column] == pytest.approx(255.0 * intensity ** (1 / 1.6), abs=1.0)


def test_sky_is_a_gradient_of_height():
    model, data = build("")
    calibration = load_calibration("pinhole")
    left = pictures(StereoCamera(model, calibration, tool_site="tool"), data)[0]
    up = (calibration.pixel_directions() @ R_TOOL_CAMERA.T)[..., 2]
    expected = 255.0 * (0.6 + 0.3 * up) ** (1 / 1.6)
    assert np.abs(left - expected).max() < 1.5


@pytest.mark.parametrize("name", ["t265", "pinhole"])
@pytest.mark.parametrize(("opening_rad", "pitch_rad"), [(0.785, 0.6), (0.1, 1.0), (0.4, 0.2)])
def test_adaptive_grid_is_close_to_the_full_grid(name: str, opening_rad: float, pitch_rad: float):
    model, data = build_scene(opening_rad=opening_rad, pitch_rad=pitch_rad)
    calibration = load_calibration(name)
    adaptive, full = (
        StereoCamera(model, calibration, tool_site=TOOL_SITE, full_grid=full_grid)
        for full_grid in (False, True)
    )
    hand = int(model.jnt_qposadr[model.body("hand").jntadr[0]])
    random = np.random.default_rng(0)
    for _ in range(4):
        data.qpos[:] = model.qpos0
        data.qpos[hand : hand + 3] += random.uniform(-0.12, 0.12, size=3)
        mujoco.mj_kinematics(model, data)
        error = np.abs(pictures(adaptive, data).astype(int) - pictures(full, data))
        assert error.mean() <= 0.05
        assert (error <= 8).mean() >= 0.999
