"""A robot in its world gets meshes; gripper, scene and what has no mesh stay as they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from common.errors import BadMeshes
from common.messages import EpisodeConfigure, EpisodeReady, Header
from common.robots import load_robot
from common.tasks import load_task
from services.sim.album import Album
from services.sim.dress import dress
from services.sim.reactor import SimReactor
from services.sim.replay import Replay
from services.sim.world import World
from tests.menagerie import FOREIGN, PANDA

HEAD = Header(cell="cell", episode="episode", epoch=1)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("menagerie")
    for foreign in FOREIGN.values():
        foreign.write(folder)
    return folder


def make_world(robot: str) -> World:
    return World(task=load_task("lid"), robot=load_robot(robot), seed=0)


@pytest.mark.parametrize("robot", sorted(FOREIGN))
def test_meshes_stand_for_the_primitives_of_their_bodies(robot: str, folder: Path):
    world = make_world(robot)
    skin = dress(world, folder)
    table = world.robot.meshes
    carriers = {f"robot_{pair.ours}" for pair in table.bodies}
    assert {world.model.body(body).name for body in skin.bodies} == carriers
    hidden = {world.model.geom(geom).name for geom in skin.hidden}
    expected = {
        world.model.geom(geom).name
        for geom in range(world.model.ngeom)
        if world.model.body(world.model.geom_bodyid[geom]).name in carriers
    }
    assert hidden == expected - {f"robot_{name}" for name in table.keep}
    assert hidden
    assert all(name.startswith("robot_") for name in hidden)


def test_meshes_follow_the_robot(folder: Path):
    world = make_world("panda")
    positions, objects = world.servos.positions(world.data), world.object_poses()
    sizes = {"task": "lid", "robot": "panda", "width": 96, "height": 72}
    meshed, plain = Replay(**sizes, meshes=folder), Replay(**sizes)
    first = meshed.draw(positions, 0.05, objects)
    assert not np.array_equal(first, plain.draw(positions, 0.05, objects))
    positions[1] -= 0.4
    assert not np.array_equal(first, meshed.draw(positions, 0.05, objects))


def test_a_replay_of_a_robot_without_meshes_is_refused(folder: Path):
    with pytest.raises(BadMeshes, match="abstract"):
        Replay(task="lid", robot="abstract", width=8, height=8, meshes=folder)


def test_pictures_of_an_episode_show_them(folder: Path):
    world = make_world("panda")
    scenes: list[bytes] = []
    for skin in (None, dress(world, folder)):
        album = Album(world, skin)
        album.remember("start", None)
        scenes += [picture.pixels for picture in album.draw(HEAD)]
    assert len(scenes) == 2
    assert scenes[0] != scenes[1]


def configure(reactor: SimReactor, robot: str) -> EpisodeReady:
    message = EpisodeConfigure(
        header=HEAD,
        task="lid",
        robot=robot,
        policy="expert",
        seed=0,
        mode="lockstep",
        pictures=True,
        nodes={kind: "cell" for kind in ("sim", "retarget", "gripper", "policy")},
    )
    (ready,) = reactor.handle([message])
    assert isinstance(ready, EpisodeReady)
    return ready


def test_a_simulation_tells_what_is_wrong_with_its_meshes(tmp_path):
    PANDA.changed("link2", pos="0 0 0.1").write(tmp_path)
    reactor = SimReactor(node="cell", meshes=tmp_path)
    problem = configure(reactor, "panda").problem
    assert problem is not None
    assert problem.code == "E-MESHES-FIT"
    assert configure(reactor, "abstract").problem is None
