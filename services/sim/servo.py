"""Low-level servos at the physics rate: tau = kp (q_des - q) + kd (v_des - v), within limits.

They run as MuJoCo actuators, so that the implicit integrator knows their damping. With an affine
bias an actuator gives kp ctrl - kp q - kd v; ctrl = q_des + (kd / kp) v_des makes that the law
above.
"""

from __future__ import annotations

import functools
import math
from collections import deque
from collections.abc import Sequence
from typing import Any, Protocol

import mujoco
import numpy as np

from common.clock import TICK_S
from common.errors import InvalidValue, WrongShape
from common.messages.base import has_unit_quaternion
from common.robots import HandServo, RobotSpec
from common.se3 import (
    Array,
    Quaternion,
    exp_quat,
    matrix_from_quat,
    multiply,
    quat_from_matrix,
    relative_rotation,
)


class Servos(Protocol):
    """What moves a robot in the simulation."""

    def reset(self, data: Any) -> None:
        """Put the robot at its start, at rest, and hold it there."""
        ...

    def place(self, data: Any, positions: Sequence[float]) -> None:
        """Put the robot at measured positions, as in `RobotState`; for pictures."""
        ...

    def command(self, positions: list[float], velocities: list[float]) -> None:
        """Take the set-point to be reached at the end of the coming tick.

        Raises:
            WrongShape: Not one number per degree of freedom.
            InvalidValue: Not a pose, where one is expected.
        """
        ...

    def hold(self) -> None:
        """Take the last set-point once more, at rest."""
        ...

    def start_tick(self, steps: int) -> None:
        """Lay out the way to the set-point over a tick's physics steps; the next starts there."""
        ...

    def apply(self, data: Any, step: int) -> None:
        """Write the controls for a physics step of the tick, counted from 0."""
        ...

    def positions(self, data: Any) -> list[float]:
        """Measured positions, as in `RobotState`."""
        ...

    def velocities(self, data: Any) -> list[float]:
        """Measured velocities, as in `RobotState`."""
        ...


class JointServos:
    """One servo per joint. A command takes effect `command_latency_s` after it was given.

    Every tick gives one set-point, a command or a hold, and takes the one of n ticks before.

    Args:
        model: Compiled world.
        robot: The robot in it.
    """

    def __init__(self, model: Any, robot: RobotSpec) -> None:
        self._start = np.array(robot.start_positions)
        joints = [model.joint(f"robot_{joint.name}") for joint in robot.joints]
        self._qpos = np.array([int(joint.qposadr[0]) for joint in joints])
        self._dof = np.array([int(joint.dofadr[0]) for joint in joints])
        controls = [model.actuator(f"servo_{joint.name}").id for joint in robot.joints]
        self._control = _consecutive(controls)
        self._lead_s = np.array([joint.kd / joint.kp for joint in robot.joints])
        self._rest = np.zeros(len(joints))
        self._latency_ticks = round(robot.command_latency_s / TICK_S)
        self._stay_at_start()

    @staticmethod
    def add_actuators(spec: Any, robot: RobotSpec) -> None:
        """Add one affine actuator per joint to a world."""
        for joint in robot.joints:
            _add_servo(spec, joint.name, kp=joint.kp, kd=joint.kd, limit=joint.torque_limit)

    def reset(self, data: Any) -> None:
        """Put the arm at its start posture."""
        data.qpos[self._qpos] = self._start
        self._stay_at_start()

    def place(self, data: Any, positions: Sequence[float]) -> None:
        """Put the arm at measured joint positions [rad]."""
        data.qpos[self._qpos] = positions

    def command(self, positions: list[float], velocities: list[float]) -> None:
        """Take joint positions [rad] and velocities [rad/s]."""
        _check("positions", len(self._start), positions)
        _check("velocities", len(self._start), velocities)
        self._send(np.array(positions), np.array(velocities))

    def hold(self) -> None:
        """Take the last set-point once more, at rest; what is under way still has its effect."""
        self._send(self._under_way[-1][0], self._rest)

    def start_tick(self, steps: int) -> None:
        """Interpolate the set-point linearly over the tick."""
        lead = self._lead_s * self._velocity
        self._controls = _fractions(steps) * (self._to - self._from) + (self._from + lead)
        self._from = self._to

    def apply(self, data: Any, step: int) -> None:
        """Write the controls of one physics step."""
        data.ctrl[self._control] = self._controls[step]

    def _send(self, positions: Array, velocities: Array) -> None:
        self._under_way.append((positions, velocities))
        self._under_way.popleft()
        self._to, self._velocity = self._under_way[0]

    def _stay_at_start(self) -> None:
        stay = (self._start, self._rest)
        # Positions and velocities, oldest first.
        self._under_way = deque([stay] * (self._latency_ticks + 1))
        self._from = self._start
        self._to, self._velocity = self._under_way[0]
        self._controls = self._start[None]

    def positions(self, data: Any) -> list[float]:
        """Joint positions [rad]."""
        return data.qpos[self._qpos].tolist()

    def velocities(self, data: Any) -> list[float]:
        """Joint velocities [rad/s]."""
        return data.qvel[self._dof].tolist()


class HandServos:
    """Three slides and a ball joint that follow a pose: the Abstract embodiment.

    The ball joint's torque kp log(R^T R_des) + kd (w_des - w) is computed here, in body axes: a
    servo on its quaternion coordinates would not point along the rotation error.
    """

    _SLIDES = ("hand_x", "hand_y", "hand_z")

    def __init__(self, model: Any, robot: RobotSpec) -> None:
        if robot.hand is None:
            raise TypeError("a free hand needs a [hand] table")
        self._servo = robot.hand
        self._start = np.array(robot.T_world_start)
        slides = [model.joint(f"robot_{name}") for name in self._SLIDES]
        ball = model.joint("robot_hand_turn")
        self._slide_qpos = np.array([int(joint.qposadr[0]) for joint in slides])
        self._slide_dof = np.array([int(joint.dofadr[0]) for joint in slides])
        self._ball_qpos = slice(int(ball.qposadr[0]), int(ball.qposadr[0]) + 4)
        self._ball_dof = slice(int(ball.dofadr[0]), int(ball.dofadr[0]) + 3)
        self._slide_control = _consecutive(
            [model.actuator(f"servo_{name}").id for name in self._SLIDES]
        )
        self._ball_control = _consecutive([model.actuator(f"servo_turn_{a}").id for a in "xyz"])
        self._lead_s = self._servo.kd_n_s_per_m / self._servo.kp_n_per_m
        self._from_p = self._to_p = self._start[:3]
        self._from_quat = self._to_quat = _normalized(self._start[3:].tolist())
        self._slides = self._start[None, :3]
        self._quats = [self._from_quat]
        self.hold()

    @staticmethod
    def add_actuators(spec: Any, hand: HandServo) -> None:
        """Add three affine servos for the slides and three motors for the ball."""
        for name in HandServos._SLIDES:
            _add_servo(
                spec, name, kp=hand.kp_n_per_m, kd=hand.kd_n_s_per_m, limit=hand.force_limit_n
            )
        for axis, letter in enumerate("xyz"):
            gear = [0.0] * 6
            gear[axis] = 1.0
            spec.add_actuator(
                name=f"servo_turn_{letter}",
                target="robot_hand_turn",
                trntype=mujoco.mjtTrn.mjTRN_JOINT,
                gear=gear,
                forcerange=[-hand.torque_limit_nm, hand.torque_limit_nm],
                forcelimited=True,
            )

    def reset(self, data: Any) -> None:
        """Put the hand at its start pose."""
        data.qpos[self._slide_qpos] = self._start[:3]
        data.qpos[self._ball_qpos] = self._start[3:]
        self._from_p = self._to_p = self._start[:3]
        self._from_quat = self._to_quat = _normalized(self._start[3:].tolist())
        self.hold()

    def place(self, data: Any, positions: Sequence[float]) -> None:
        """Put the hand at a measured pose."""
        data.qpos[self._slide_qpos] = positions[:3]
        data.qpos[self._ball_qpos] = positions[3:]

    def command(self, positions: list[float], velocities: list[float]) -> None:
        """Take a pose `[x, y, z, qw, qx, qy, qz]` and a twist (world linear, body angular)."""
        _check("positions", 7, positions)
        _check("velocities", 6, velocities)
        if not has_unit_quaternion(positions):
            raise InvalidValue("RobotCommand quaternion", positions[3:], "length 1")
        self._to_p = np.array(positions[:3])
        self._to_quat = _normalized(positions[3:])
        self._v = np.array(velocities[:3])
        self._w = velocities[3:]

    def hold(self) -> None:
        """Stay at the last set-point."""
        self._v = np.zeros(3)
        self._w = [0.0, 0.0, 0.0]

    def start_tick(self, steps: int) -> None:
        """Interpolate position linearly and rotation along one axis over the tick."""
        x, y, z = relative_rotation(self._from_quat, self._to_quat)
        fractions = _fractions(steps)
        lead = self._lead_s * self._v
        self._slides = fractions * (self._to_p - self._from_p) + (self._from_p + lead)
        self._quats = [
            multiply(self._from_quat, exp_quat((f * x, f * y, f * z)))
            for f in fractions[:, 0].tolist()
        ]
        self._from_p, self._from_quat = self._to_p, self._to_quat

    def apply(self, data: Any, step: int) -> None:
        """Write the controls of one physics step."""
        data.ctrl[self._slide_control] = self._slides[step]
        kp, kd = self._servo.kp_nm_per_rad, self._servo.kd_nm_s_per_rad
        quat: Quaternion = tuple(data.qpos[self._ball_qpos].tolist())
        error_rad = relative_rotation(quat, self._quats[step])
        w = data.qvel[self._ball_dof].tolist()
        data.ctrl[self._ball_control] = [
            kp * e + kd * (w_des - w) for e, w_des, w in zip(error_rad, self._w, w, strict=True)
        ]

    def positions(self, data: Any) -> list[float]:
        """Measured pose `[x, y, z, qw, qx, qy, qz]`, the quaternion with qw >= 0."""
        R: Array = matrix_from_quat(data.qpos[self._ball_qpos])
        return [*data.qpos[self._slide_qpos].tolist(), *quat_from_matrix(R)]

    def velocities(self, data: Any) -> list[float]:
        """Linear velocity in world axes [m/s], angular velocity in body axes [rad/s]."""
        return [
            *data.qvel[self._slide_dof].tolist(),
            *data.qvel[self._ball_dof].tolist(),
        ]


def _add_servo(spec: Any, joint: str, *, kp: float, kd: float, limit: float) -> None:
    spec.add_actuator(
        name=f"servo_{joint}",
        target=f"robot_{joint}",
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        gaintype=mujoco.mjtGain.mjGAIN_FIXED,
        gainprm=[kp] + [0.0] * 9,
        biastype=mujoco.mjtBias.mjBIAS_AFFINE,
        biasprm=[0.0, -kp, -kd] + [0.0] * 7,
        forcerange=[-limit, limit],
        forcelimited=True,
    )


def _check(what: str, expected: int, values: list[float]) -> None:
    if len(values) != expected:
        raise WrongShape(what, expected, len(values))
    if not all(map(math.isfinite, values)):
        raise InvalidValue(what, values, "finite numbers")


@functools.cache
def _fractions(steps: int) -> Array:
    """(steps, 1) shares of a tick at the ends of its physics steps."""
    fractions = np.arange(1, steps + 1)[:, None] / steps
    fractions.flags.writeable = False
    return fractions


def _consecutive(indices: list[int]) -> slice:
    """Indices of things that were added one after the other: a slice is written to much faster."""
    first = indices[0]
    if indices != list(range(first, first + len(indices))):
        raise AssertionError(f"not one after the other: {indices}")
    return slice(first, first + len(indices))


def _normalized(quat_wxyz: list[float]) -> Quaternion:
    w, x, y, z = quat_wxyz
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    return w / norm, x / norm, y / norm, z / norm
