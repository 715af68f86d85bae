"""Ray-traced pictures against closed forms, MuJoCo's single rays and the full grid."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from common.calibration import R_TOOL_CAMERA, StereoCalibration, load_calibration
from services.sim.camera import StereoCamera, Tracer
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


RAYS = random_rays(100)


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


KINDS = ("plane", "sphere", "capsule", "ellipsoid", "cylinder", "box")
ALL_GROUPS = np.ones(6, dtype=np.uint8)


def random_shape(kind: str, random: np.random.Generator) -> str:
    """A geom of one kind with random size and pose, centre within 0.3 m of the origin."""
    size = " ".join(str(value) for value in random.uniform(0.05, 0.5, size=3))
    pos = " ".join(str(value) for value in random.uniform(-0.3, 0.3, size=3))
    quat = " ".join(str(value) for value in random.normal(size=4))
    return f'<geom type="{kind}" size="{size}" pos="{pos}" quat="{quat}"/>'


def assert_same_hits(
    model: mujoco.MjModel, data: mujoco.MjData, origin: np.ndarray, rays: np.ndarray
) -> int:
    """Compare with MuJoCo's rays, and count the hits."""
    count = len(rays)
    geom, distance = np.zeros(count, dtype=np.int32), np.zeros(count)
    normal = np.zeros(3 * count)
    mujoco.mj_multiRay(
        model, data, origin, rays.ravel(), ALL_GROUPS, True, -1, geom, distance, normal, count, 1e10
    )
    hits = Tracer(model).trace(data, origin, rays)
    assert np.array_equal(hits.geom, geom)
    assert np.abs(hits.distance / distance - 1.0).max() < 1e-9
    assert np.abs(hits.normal - normal.reshape(-1, 3)).max() < 1e-9
    return int((geom >= 0).sum())


@pytest.mark.parametrize("kind", KINDS)
def test_hits_from_outside_and_inside_are_those_of_mujoco(kind: str):
    random, inside, outside = np.random.default_rng(7), 0, 0
    for _ in range(40):
        model, data = build(random_shape(kind, random))
        center = data.geom_xpos[0].copy()
        inside += assert_same_hits(model, data, center + 0.01 * random.normal(size=3), RAYS)
        start = 1.5 * random.normal(size=3)
        aimed = center + random.uniform(-0.5, 0.5, size=(200, 3)) - start
        outside += assert_same_hits(model, data, start, aimed)
    assert outside > 500
    assert inside > 500


@pytest.mark.parametrize("kind", KINDS)
def test_rays_along_the_axes_of_a_shape_hit_as_in_mujoco(kind: str):
    random, hits = np.random.default_rng(8), 0
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    for _ in range(60):
        # Not turned: the rays are exactly parallel to the faces and the axis.
        size = random.uniform(0.1, 0.5, size=3)
        model, data = build(f'<geom type="{kind}" size="{size[0]} {size[1]} {size[2]}"/>')
        for start in (random.uniform(-0.7, 0.7, size=3), np.zeros(3) + [0.0, 0.0, 0.05]):
            hits += assert_same_hits(model, data, start, axes)
    assert hits > 60


@pytest.mark.parametrize("kind", KINDS)
def test_grazing_rays_hit_or_miss_as_the_outline_says(kind: str):
    """A nanometre inside the outline a ray hits, a nanometre outside it does not.

    The outline in the x-y plane is found by bisection with MuJoCo's rays, parallel to z.
    """
    model, data = build(f'<geom type="{kind}" size="0.3 0.2 0.25"/>')
    tracer, down, found = Tracer(model), np.array([0.0, 0.0, -1.0]), np.zeros(1, dtype=np.int32)
    for angle in np.linspace(0.1, 6.2, 40):
        across = np.array([math.cos(angle), math.sin(angle), 0.0])
        low, high = 0.0, 2.0
        while high - low > 1e-12:
            middle = 0.5 * (low + high)
            start = middle * across + [0.0, 0.0, 1.0]
            mujoco.mj_ray(model, data, start, down, ALL_GROUPS, True, -1, found)
            low, high = (middle, high) if found[0] >= 0 else (low, middle)
        for radius, hit in ((low - 1e-9, 0), (high + 1e-9, -1)):
            start = radius * across + [0.0, 0.0, 1.0]
            assert tracer.trace(data, start, down[None]).geom[0] == hit


def test_hits_among_many_shapes_are_those_of_mujoco():
    random, hits = np.random.default_rng(9), 0
    for _ in range(10):
        model, data = build("".join(random_shape(kind, random) for kind in KINDS[1:] * 4))
        for scale in (0.3, 2.0):
            start = scale * random.normal(size=3)
            hits += assert_same_hits(model, data, start, RAYS * random.uniform(0.5, 3.0))
    assert hits > 500


def test_the_lower_geom_is_met_where_two_coincide():
    box = '<geom type="box" size="0.1 0.1 0.1" pos="1 0 1"/>'
    model, data = build(box + box)
    assert Tracer(model).trace(data, EYE, np.array([[1.0, 0.0, 0.0]])).geom.tolist() == [0]


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
