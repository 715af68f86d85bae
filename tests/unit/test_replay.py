"""A recorded state is shown as it was."""

import numpy as np
import pytest

from client.video import write_video
from common.clock import TICK_S
from common.errors import InvalidValue
from common.robots import load_robot
from common.tasks import load_task
from services.sim.replay import Replay
from services.sim.world import World


def moved(robot: str) -> World:
    """A world some time after its start, with fingers half closed."""
    world = World(task=load_task("lid"), robot=load_robot(robot), seed=3)
    world.fingers.command([0.4, 0.4], current_limit_a=0.6)
    positions = world.servos.positions(world.data)
    positions[0] += 0.05
    world.servos.command(positions, [0.0] * len(world.servos.velocities(world.data)))
    for _ in range(60):
        world.advance(TICK_S)
    return world


@pytest.mark.parametrize("robot", ["abstract", "panda", "spot"])
def test_everything_is_where_it_was(robot: str):
    world = moved(robot)
    shown = World(task=world.task, robot=world.robot, seed=0)
    opening_m = world.fingers.opening_m(world.data)
    shown.show(world.servos.positions(world.data), opening_m, world.object_poses())
    here = np.abs(shown.data.geom_xpos - world.data.geom_xpos).max(axis=1)
    # The fingers' equalities are soft: by less than a pixel.
    assert here.max() < 2e-3
    objects = [
        geom for geom in range(world.model.ngeom) if world.model.geom(geom).name[:3] == "lid"
    ]
    assert len(objects) == 5
    assert here[objects].max() < 1e-12


def test_pictures_follow_the_state():
    world = moved("panda")
    positions, objects = world.servos.positions(world.data), world.object_poses()
    replay = Replay(task="lid", robot="panda", width=64, height=48)
    first = replay.draw(positions, 0.05, objects)
    assert first.shape == (48, 64, 3)
    assert np.array_equal(replay.draw(positions, 0.05, objects), first)
    objects["lid"][2] += 0.3
    assert not np.array_equal(replay.draw(positions, 0.05, objects), first)


def test_an_unknown_kind_of_video_is_refused(tmp_path):
    with pytest.raises(InvalidValue, match=r"\.webp, \.gif, \.png"):
        write_video(None, tmp_path / "episode.mp4", spec=None)
