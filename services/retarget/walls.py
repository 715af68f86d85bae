"""Virtual walls: planes that sites of the robot may not cross."""

from __future__ import annotations

import numpy as np

from common.se3 import Array
from services.retarget.approach import ApproachLimit
from services.retarget.robot_model import RobotModel
from services.retarget.rows import Approach


class Walls:
    """Distances of sites to the robot's walls, and how fast they may shrink.

    Row of a wall: normal' J_p a <= speed.

    Args:
        model: The robot.
        limit: Distance to speed of approach.
        fastest_m_s: No site moves faster; a wall that allows more does not matter.
    """

    def __init__(self, model: RobotModel, limit: ApproachLimit, *, fastest_m_s: float) -> None:
        self._model = model
        self._limit = limit
        self._fastest_m_s = fastest_m_s
        self._walls = [
            (wall.name, model.find_site(wall.site), np.array(wall.point), np.array(wall.normal))
            for wall in model.spec.walls
        ]

    def __bool__(self) -> bool:
        return bool(self._walls)

    def list_near(self) -> list[Approach]:
        """Walls that are near enough to matter, at the configuration of `RobotModel.update`."""
        near: list[Approach] = []
        for name, frame, point, normal in self._walls:
            p: Array = self._model.data.oMf[frame].translation
            distance_m = float(normal @ (point - p))
            speed = self._limit.speed(distance_m)
            if speed < self._fastest_m_s:
                J = self._model.compute_site(frame)[1]
                near.append(Approach(normal @ J[:3], distance_m, speed, name))
        return near
