"""The retargeter of a robot with joints: tasks, bounds, hierarchy, integration."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from common.clock import TICK_S
from common.errors import InvalidValue, WrongShape
from common.se3 import Array
from common.tasks import Obstacle
from services.retarget.approach import ApproachLimit
from services.retarget.bounds import Box, JointBounds, JointLimits
from services.retarget.collision import Collisions
from services.retarget.hand_task import compute_hand_twist
from services.retarget.head_task import HeadTask
from services.retarget.hierarchy import Hierarchy
from services.retarget.level import Level, LevelShape
from services.retarget.reference import TickReference
from services.retarget.retargeter import Motion
from services.retarget.robot_model import RobotModel
from services.retarget.rows import Rows, gather_rows
from services.retarget.walls import Walls

_AT_BOUND = 1e-6


class WholeBodyRetargeter:
    """Follows with all joints, under position, velocity and acceleration limits.

    It integrates its command, q+ = q + a dt: that is what the bounds' guarantees hold for, and what
    keeps servo errors from becoming hand errors. The measurement only keeps the command from
    running away.

    Args:
        model: The robot's kinematics.
        obstacles: Fixed boxes of the task that its links keep away from.

    Raises:
        BadRobotFile: A wall or collision pair cannot be used.
        UnknownName: robot.toml asks for a solver that is not installed.
    """

    def __init__(self, model: RobotModel, obstacles: Sequence[Obstacle] = ()) -> None:
        spec = model.spec
        self._model = model
        self._gains = spec.retarget
        self._names = [joint.name for joint in spec.joints]
        self._bias = np.array([joint.bias for joint in spec.joints])
        self._H = np.array([joint.level1_weight for joint in spec.joints])
        self._W = np.array([joint.level2_weight for joint in spec.joints])
        self._T = np.array([1.0, 1.0, 1.0, *[self._gains.rotation_scale_m] * 3])
        self._stop_change = TICK_S * np.array(
            [joint.stop_acceleration or joint.acceleration_limit for joint in spec.joints]
        )
        self._bounds = JointBounds(list_limits(model), dt_s=TICK_S)
        self._latency_ticks = round(spec.command_latency_s / TICK_S)
        gains = self._gains
        walls = ApproachLimit(gains.wall_gain_per_s, gains.wall_acceleration_m_s2, 0.0, TICK_S)
        self._walls = Walls(model, walls, fastest_m_s=2.0 * gains.hand_speed_cap_m_s)
        self._obstacles = tuple(obstacles)
        self.start([joint.start for joint in spec.joints])

    @property
    def T_world_hand(self) -> Array:
        """(4, 4) tool pose that is commanded at this moment."""
        return self._model.compute_tool_pose(self._q)

    def compute_tool_pose(self, positions: Sequence[float]) -> Array:
        """T_world_tool (4, 4) at measured joint positions."""
        return self._model.compute_tool_pose(np.array(positions))

    def start(self, positions: Sequence[float]) -> None:
        """Begin at the measured positions, at rest, with nothing remembered.

        Raises:
            WrongShape: Not one position per joint.
            InvalidValue: A position is not finite.
        """
        spec = self._model.spec
        if len(positions) != spec.nq:
            raise WrongShape("start positions", spec.nq, len(positions))
        if not np.isfinite(positions).all():
            raise InvalidValue("start positions", list(positions), "finite numbers")
        self._q = np.array(positions, dtype=float)
        self._a = np.zeros(len(self._names))
        self._sent = deque([self._q], maxlen=self._latency_ticks + 1)
        margin = ApproachLimit(
            self._gains.wall_gain_per_s,
            self._gains.wall_acceleration_m_s2,
            spec.collision.margin_m,
            TICK_S,
        )
        self._collisions = Collisions(self._model, self._obstacles, margin)
        self._head = HeadTask(self._model, spec.head, self._q) if spec.head else None
        self._looks_around = bool(self._head or self._walls or self._collisions)
        shapes = [LevelShape(6, self._model.hand_joints)]
        if self._head:
            shapes.append(self._head.shape)
        # The posture's is the last.
        self._levels = len(shapes) + 1
        self._hierarchy = Hierarchy(
            H=self._H,
            W=self._W,
            shapes=shapes,
            mode=self._gains.mode,
            solver=self._gains.solver,
        )

    def follow(self, reference: TickReference, measured: Sequence[float] | None = None) -> Motion:
        """Plan one tick and integrate it.

        Args:
            reference: Where the gripper should be.
            measured: Measured joint positions; without them the command is trusted.
        """
        T_world_hand, J1 = self._model.compute_hand(self._q)
        x1 = compute_hand_twist(
            T_world_hand, reference.T_world_start, reference.twist, self._gains, TICK_S
        )
        levels = [Level(J1, x1, self._T)]
        rows = None
        if self._looks_around:
            self._model.update(self._q)
            rows = gather_rows(
                [*self._walls.list_near(), *self._collisions.list_near()], len(self._q)
            )
        if self._head:
            levels.append(self._head.aim())
        x = self._gains.posture_gain_per_s * (self._bias - self._q)
        box = self._bounds.compute(self._q, self._a, self._predict(measured))
        solution = self._hierarchy.solve(levels, x, box, rows)
        self._a = solution.a
        self._q = self._q + TICK_S * solution.a
        self._sent.append(self._q)
        return Motion(
            positions=self._q.tolist(),
            velocities=self._a.tolist(),
            scaling=solution.scaling,
            active_limits=self._list_active(box, rows),
            failures=solution.failures,
        )

    def brake(self, ticks: int) -> Motion:
        """Come to rest, every joint for itself: a+ = a - clip(a, -A dt, A dt), for some ticks.

        Args:
            ticks: How many have passed: states that were missed do not make a stop longer.
        """
        for _ in range(ticks):
            self._a = self._a - np.clip(self._a, -self._stop_change, self._stop_change)
            self._q = self._q + TICK_S * self._a
        self._sent.append(self._q)
        return Motion(
            positions=self._q.tolist(),
            velocities=self._a.tolist(),
            scaling=[0.0] * self._levels,
            active_limits=[],
            failures=0,
        )

    def _predict(self, measured: Sequence[float] | None) -> Array | None:
        """Where the joints (n,) will be when all that was sent has had its effect."""
        if measured is None:
            return None
        return np.array(measured) + (self._q - self._sent[0])

    def _list_active(self, box: Box, rows: Rows | None) -> list[str]:
        a = self._a
        at = np.minimum(a - box.lower, box.upper - a) <= _AT_BOUND
        active = [self._names[i] for i in at.nonzero()[0].tolist()]
        if rows is not None:
            tight = (rows.C @ a >= rows.U - _AT_BOUND).nonzero()[0].tolist()
            active += [rows.names[i] for i in tight if i < len(rows.names)]
        return active


def list_limits(model: RobotModel) -> list[JointLimits]:
    """Limits of all joints of a robot."""
    return [
        JointLimits(lower, upper, joint.velocity_limit, joint.acceleration_limit, joint.lead_limit)
        for joint, lower, upper in zip(
            model.spec.joints, model.lower.tolist(), model.upper.tolist(), strict=True
        )
    ]
