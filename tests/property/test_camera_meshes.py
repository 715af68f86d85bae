"""A tree of boxes finds what trying every triangle finds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.robots.meshes import Shell
from services.sim.camera.meshes import pack
from services.sim.camera.meshes.boxes import LEAF, arrange
from tests.mesh_tracer import trace_hull

RAYS = 40


def make_shell(corners: np.ndarray) -> Shell:
    return Shell("body", corners, np.ones_like(corners), np.ones((len(corners), 3)))


def scatter(count: int, size: float, seed: int) -> np.ndarray:
    """Triangles about the origin; every third one lies flat on a plane of its box."""
    random = np.random.default_rng(seed)
    corners = random.uniform(-1, 1, (count, 1, 3)) + size * random.uniform(-1, 1, (count, 3, 3))
    corners[::3, :, seed % 3] = corners[::3, :1, seed % 3]
    return corners


def aim(seed: int, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rays from around towards points of triangles, some along an axis."""
    random = np.random.default_rng(seed + 1)
    origins = random.uniform(-3, 3, (RAYS, 3))
    weights = random.dirichlet(np.ones(3), RAYS)
    targets = np.einsum("nj,njk->nk", weights, corners[random.integers(len(corners), size=RAYS)])
    directions = targets - origins
    directions[::8] = np.eye(3)[np.arange(0, RAYS, 8) % 3]
    origins[::8] = targets[::8] - 3.0 * directions[::8]
    return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)


def try_all(
    corners: np.ndarray, origins: np.ndarray, directions: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Nearest hits by solving o + t d = a + u (b - a) + v (c - a), and how clear each is."""
    a, b, c = corners.transpose(1, 0, 2)
    columns = [np.broadcast_to(-directions[:, None], (len(origins), *a.shape)), b - a, c - a]
    system = np.stack([np.broadcast_to(each, columns[0].shape) for each in columns], axis=-1)
    right = (origins[:, None] - a)[..., None]
    regular = np.abs(np.linalg.det(system)) > 1e-12
    system[~regular] = np.eye(3)
    t, u, v = np.moveaxis(np.linalg.solve(system, right)[..., 0], -1, 0)
    margin = np.minimum(np.minimum(u, v), 1.0 - u - v)
    hit = np.where(regular & (margin >= 0.0) & (t >= 0.0), t, np.inf)
    doubtful = (np.abs(margin) < 1e-7) | ~regular
    return hit.min(axis=1), doubtful.any(axis=1)


@settings(max_examples=60)
@given(
    count=st.integers(1, 150),
    size=st.sampled_from([1e-3, 0.05, 1.0]),
    seed=st.integers(0, 2**31),
)
def test_the_tree_finds_what_every_triangle_gives(count: int, size: float, seed: int):
    corners = scatter(count, size, seed)
    origins, directions = aim(seed, corners)
    expected, doubtful = try_all(corners, origins, directions)
    hull, _ = pack([make_shell(corners)])
    distances, triangles = trace_hull(hull, origins, directions)
    clear = ~doubtful
    assert clear.any()
    np.testing.assert_array_equal(np.isinf(distances[clear]), np.isinf(expected[clear]))
    met = clear & np.isfinite(distances)
    np.testing.assert_allclose(distances[met], expected[met], rtol=0, atol=1e-8)
    assert ((triangles >= 0) == np.isfinite(distances)).all()
    some, _ = trace_hull(hull, origins, directions, any_will_do=True)
    np.testing.assert_array_equal(np.isfinite(some), np.isfinite(distances))
    assert (some >= distances).all()


@settings(max_examples=60)
@given(count=st.integers(1, 300), seed=st.integers(0, 2**31))
def test_every_triangle_is_in_one_leaf_and_in_its_boxes(count: int, seed: int):
    corners = scatter(count, 0.2, seed)
    tree = arrange(corners)
    assert sorted(tree.order.tolist()) == list(range(count))
    assert len(tree.boxes) == 2 ** (tree.depth + 1) - 1
    leaves = 1 << tree.depth
    for leaf in range(leaves):
        held = corners[tree.order[(leaf * count) // leaves : ((leaf + 1) * count) // leaves]]
        assert min(count, LEAF) <= len(held) <= 2 * LEAF
        node = leaf + leaves - 1
        while True:
            lower, upper = tree.boxes[node]
            assert (held > lower).all()
            assert (held < upper).all()
            if node == 0:
                break
            node = (node - 1) // 2


@pytest.mark.parametrize("count", [2, 9, 64])
def test_triangles_that_coincide_are_no_trouble(count: int):
    corners = np.tile([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]], (count, 1, 1))
    hull, _ = pack([make_shell(corners)])
    origins, directions = np.array([[0.2, 0.2, 2.0]]), np.array([[0.0, 0.0, -1.0]])
    distances, _ = trace_hull(hull, origins, directions)
    assert distances.tolist() == [2.0]


def test_no_ray_slips_between_neighbours():
    """A fan around the origin, hit exactly on its edges and its middle."""
    angles = np.linspace(0.0, 2.0 * np.pi, 13)
    rim = np.stack([np.cos(angles), np.sin(angles), np.zeros(13)], axis=1)
    corners = np.stack([np.zeros((12, 3)), rim[:-1], rim[1:]], axis=1)
    hull, _ = pack([make_shell(corners)])
    origin = np.array([0.3, -0.2, 1.7])
    targets = np.concatenate([np.outer(np.linspace(0.0, 0.95, 40), edge) for edge in rim])
    directions = targets - origin
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    distances, _ = trace_hull(hull, np.tile(origin, (len(directions), 1)), directions)
    assert np.isfinite(distances).all()
