"""Virtual walls and obstacles: never passed, and never a reason to stop sliding along them."""

import coal
import numpy as np
import pinocchio as pin
import pytest

from common.robots import WallSpec
from common.se3 import exp3
from common.tasks import Obstacle
from services.retarget.reference import TickReference
from services.retarget.robot_model import RobotModel
from services.retarget.whole_body import WholeBodyRetargeter
from tests.retarget_runs import BODIES, jumping_references, robot_model

PENETRATION_M = 1e-3


def _with_walls(name, walls):
    spec = robot_model(name).spec
    return RobotModel(spec.model_copy(update={"walls": tuple(walls)}))


def _drive(retargeter, T_start, velocity, ticks):
    """Ask for a constant velocity from the first tick on; give the hand's positions (ticks, 3)."""
    path = []
    for tick in range(ticks):
        T = T_start.copy()
        T[:3, 3] += 0.01 * tick * velocity
        retargeter.follow(TickReference(T, T, np.r_[velocity, 0.0, 0.0, 0.0]))
        path.append(retargeter.T_world_hand[:3, 3])
    return np.array(path)


@pytest.mark.parametrize("normal", [(1, 0, 0), (0, 1, 0), (0, 0, -1), (0.6, 0, -0.8)])
@pytest.mark.parametrize("name", BODIES)
def test_the_hand_slides_along_a_wall(name, normal):
    normal = np.array(normal, dtype=float)
    spec = robot_model(name).spec
    start = robot_model(name).compute_tool_pose(np.array(spec.start_positions))
    point = start[:3, 3] + 0.08 * normal
    wall = WallSpec(name="wall", point=tuple(point), normal=tuple(normal))
    retargeter = WholeBodyRetargeter(_with_walls(name, [wall]))
    along = np.cross(normal, [0.0, 0.6, 0.8])
    along /= np.linalg.norm(along)
    # 1 m/s, half of it into the wall.
    path = _drive(retargeter, start, np.sqrt(0.5) * (normal + along), 40)
    assert ((path - point) @ normal).max() <= PENETRATION_M
    free = _drive(WholeBodyRetargeter(robot_model(name)), start, np.sqrt(0.5) * along, 40)
    slid = float((path[-1] - start[:3, 3]) @ along)
    assert slid >= 0.7 * float((free[-1] - start[:3, 3]) @ along)
    # The wall was in the way: the hand came close to it.
    assert ((path - point) @ normal).max() >= -0.03


@pytest.mark.parametrize("name", BODIES)
def test_the_fastest_hand_stops_at_a_wall(name):
    spec = robot_model(name).spec
    start = robot_model(name).compute_tool_pose(np.array(spec.start_positions))
    normal = np.array([0.0, 1.0, 0.0])
    free = WholeBodyRetargeter(robot_model(name))
    far = _drive(free, start, normal, 60)
    speeds = np.diff(far @ normal) / 0.01
    # As fast as the robot can, up to 1 m/s, and the wall where it is fastest.
    fastest = int(np.argmax(speeds > min(0.95 * speeds.max(), 1.0)))
    point = far[fastest] + 0.2 * normal
    wall = WallSpec(name="wall", point=tuple(point), normal=tuple(normal))
    path = _drive(WholeBodyRetargeter(_with_walls(name, [wall])), start, normal, 150)
    assert ((path - point) @ normal).max() <= PENETRATION_M
    assert ((path - point) @ normal).max() >= -0.03


@pytest.mark.parametrize("name", BODIES)
def test_a_corner_of_walls_is_kept(name):
    model = robot_model(name)
    start = model.compute_tool_pose(np.array(model.spec.start_positions))
    normals = ([1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0])
    points = [start[:3, 3] + 0.12 * np.array(normal) for normal in normals]
    walls = [
        WallSpec(name=f"wall-{i}", point=tuple(point), normal=tuple(normal))
        for i, (point, normal) in enumerate(zip(points, normals, strict=True))
    ]
    retargeter = WholeBodyRetargeter(_with_walls(name, walls))
    most, failures = -1.0, 0
    for reference in jumping_references(np.random.default_rng(3), 600):
        failures += retargeter.follow(reference).failures
        p = retargeter.T_world_hand[:3, 3]
        for point, normal in zip(points, normals, strict=True):
            most = max(most, float((p - point) @ normal))
    assert most <= PENETRATION_M
    assert most >= -0.02
    assert failures == 0


def _distances(model, obstacles):
    """Distances of all pairs, computed here from the geoms of the MuJoCo model."""
    pairs = [(one, other) for one, other in model.spec.collision.pairs]
    pairs += [(geom, box) for box in obstacles for geom in model.spec.collision.obstacle_geoms]

    def place(thing, q):
        if isinstance(thing, Obstacle):
            x, y, z = thing.half_size_m
            return coal.Box(2 * x, 2 * y, 2 * z), pin.SE3(thing.T_world_box)
        joint, placement = model.place_geom(thing)
        size, kind = model.mj.geom(thing).size, int(model.mj.geom(thing).type[0])
        shape = {
            2: lambda: coal.Sphere(size[0]),
            3: lambda: coal.Capsule(size[0], 2 * size[1]),
            5: lambda: coal.Cylinder(size[0], 2 * size[1]),
            6: lambda: coal.Box(*(2 * size)),
        }[kind]()
        return shape, model.data.oMi[joint] * placement

    def measure(q):
        model.update(np.array(q))
        result = []
        for one, other in pairs:
            (shape_1, M_1), (shape_2, M_2) = place(one, q), place(other, q)
            found = coal.DistanceResult()
            result.append(
                coal.distance(
                    shape_1,
                    coal.Transform3s(M_1.rotation, M_1.translation),
                    shape_2,
                    coal.Transform3s(M_2.rotation, M_2.translation),
                    coal.DistanceRequest(),
                    found,
                )
            )
        return np.array(result)

    return measure


@pytest.mark.long
@pytest.mark.parametrize("name", BODIES)
def test_links_keep_off_each_other_and_off_the_table(name):
    model = robot_model(name)
    # A table where the arm would like to be.
    T = np.eye(4)
    T[:3, 3] = [0.55, -0.1, 0.55]
    obstacles = (Obstacle("table", T, (0.4, 0.6, 0.05)),)
    measure = _distances(model, obstacles)
    random = np.random.default_rng(1)
    retargeter = WholeBodyRetargeter(model, obstacles)
    loose = WholeBodyRetargeter(
        RobotModel(model.spec.model_copy(update={"collision": type(model.spec.collision)()}))
    )
    kept, free = [], []
    for reference in jumping_references(random, 1500):
        R = exp3([0.0, 0.3, 0.0]) @ reference.T_world_start[:3, :3]
        T_wanted = reference.T_world_start.copy()
        T_wanted[:3, :3] = R
        wanted = TickReference(T_wanted, T_wanted, np.zeros(6))
        kept.append(measure(retargeter.follow(wanted).positions).min())
        free.append(measure(loose.follow(wanted).positions).min())
    margin = model.spec.collision.margin_m
    assert min(kept) > 0.0
    assert np.quantile(kept, 0.01) > 0.5 * margin
    # Without the rows it would have hit something.
    assert min(free) < 0.0
