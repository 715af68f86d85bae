"""What was recorded, seen from the task's viewpoint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from common.robots import load_robot
from common.tasks import load_task
from services.sim.camera import SceneRenderer
from services.sim.dress import dress
from services.sim.world import World


class Replay:
    """Draws recorded states of one task with one robot.

    Args:
        task: Its name.
        robot: Its name.
        width: Of the pictures [px].
        height: Of the pictures [px].
        meshes: Folder of the robot's meshes; without it, it is drawn from primitives.

    Raises:
        UnknownName: There is no such task or robot.
        BadMeshes: The robot has no meshes, or they are not in that folder.
        MeshesDoNotFit: The meshes would not move as the robot does.
        InvalidValue: A size that is not positive.
    """

    def __init__(
        self, *, task: str, robot: str, width: int, height: int, meshes: Path | None = None
    ) -> None:
        self._world = World(task=load_task(task), robot=load_robot(robot), seed=0)
        skin = dress(self._world, meshes) if meshes else None
        self._renderer = SceneRenderer(self._world.model, width=width, height=height, skin=skin)

    def draw(
        self, positions: Sequence[float], opening_m: float, objects: Mapping[str, Sequence[float]]
    ) -> npt.NDArray[np.uint8]:
        """Draw one state.

        Args:
            positions: Of the robot, as in `RobotState`.
            opening_m: Distance between the finger pads.
            objects: Name -> T_world_object as it travels, for every object of the task.

        Returns:
            (height, width, 3) red, green, blue; rows from the top.
        """
        self._world.show(positions, opening_m, objects)
        return self._renderer.render(self._world.data, self._world.task.scene_camera)
