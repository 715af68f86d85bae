"""The head task: the head keeps its orientation in the world while the body moves."""

from __future__ import annotations

import math

import numpy as np

from common.robots import HeadSpec
from common.se3 import Array, log3
from services.retarget.level import Level, LevelShape
from services.retarget.robot_model import RobotModel


class HeadTask:
    """x = min(K |e|, cap) e / |e| with e = log3(R_wanted R'), world axes.

    Args:
        model: The robot.
        head: Site and gains.
        q: (n,) joint positions at which the head has the orientation that it keeps.
    """

    def __init__(self, model: RobotModel, head: HeadSpec, q: Array) -> None:
        self._model = model
        self._head = head
        self._frame = model.find_site(head.site)
        self.shape = LevelShape(3, model.list_moving(self._frame))
        self._T = np.ones(3)
        model.update(q)
        self._R_wanted: Array = model.compute_site(self._frame)[0][:3, :3].copy()

    def aim(self) -> Level:
        """The level of this tick, at the configuration of `RobotModel.update`."""
        T_world_head, J = self._model.compute_site(self._frame)
        e = log3(self._R_wanted @ T_world_head[:3, :3].T)
        size = math.hypot(*e.tolist())
        gain = self._head.gain_per_s
        if gain * size > self._head.turn_cap_rad_s:
            gain = self._head.turn_cap_rad_s / size
        return Level(J[3:], gain * e, self._T)
