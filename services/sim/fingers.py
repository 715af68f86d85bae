"""The gripper's two motors in the simulation: current-based position control."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from common.calibration.four_bar import (
    MOTOR_TORQUE_NM_PER_A,
    OPEN_RAD,
    driver_rad,
    opening_m,
)

_SIDES = ("left", "right")
_KP_NM_PER_RAD = 12.0
_KD_NM_S_PER_RAD = 0.4
_STALL_TORQUE_NM = 4.1


class Fingers:
    """Position servos whose torque is capped by the commanded current limit."""

    def __init__(self, model: Any) -> None:
        self._model = model
        drivers = [model.joint(f"gripper_{side}_driver") for side in _SIDES]
        self._qpos = np.array([int(joint.qposadr[0]) for joint in drivers])
        self._dof = np.array([int(joint.dofadr[0]) for joint in drivers])
        self._control = np.array([model.actuator(f"motor_{side}").id for side in _SIDES])
        self._goal = np.full(2, OPEN_RAD)
        self._current_limit_a = -1.0
        self._followers = [
            (int(model.joint(f"gripper_{side}_{part}").qposadr[0]), sign)
            for side in _SIDES
            for part, sign in (("finger", -1.0), ("passive", 1.0))
        ]

    @staticmethod
    def add_actuators(spec: Any) -> None:
        """Add the two motors to a world."""
        for side in _SIDES:
            spec.add_actuator(
                name=f"motor_{side}",
                target=f"gripper_{side}_driver",
                trntype=mujoco.mjtTrn.mjTRN_JOINT,
                gaintype=mujoco.mjtGain.mjGAIN_FIXED,
                gainprm=[_KP_NM_PER_RAD] + [0.0] * 9,
                biastype=mujoco.mjtBias.mjBIAS_AFFINE,
                biasprm=[0.0, -_KP_NM_PER_RAD, -_KD_NM_S_PER_RAD] + [0.0] * 7,
                forcerange=[-_STALL_TORQUE_NM, _STALL_TORQUE_NM],
                forcelimited=True,
            )

    def reset(self, data: Any) -> None:
        """Open both fingers."""
        self.place(data, opening_m(OPEN_RAD))
        self.command([OPEN_RAD, OPEN_RAD], current_limit_a=0.0)

    def place(self, data: Any, distance_m: float) -> None:
        """Put both fingers where the pads are this far apart."""
        angle_rad = driver_rad(distance_m)
        data.qpos[self._qpos] = angle_rad
        for address, sign in self._followers:
            data.qpos[address] = sign * angle_rad

    def command(self, positions_rad: list[float], *, current_limit_a: float) -> None:
        """Take goals of left and right motor [rad], positive = open, and the current cap [A]."""
        self._goal[:] = positions_rad
        if current_limit_a != self._current_limit_a:
            self._current_limit_a = current_limit_a
            limit = min(MOTOR_TORQUE_NM_PER_A * current_limit_a, _STALL_TORQUE_NM)
            self._model.actuator_forcerange[self._control] = (-limit, limit)

    def apply(self, data: Any) -> None:
        """Write the controls, which hold until the next command."""
        data.ctrl[self._control] = self._goal

    def positions_rad(self, data: Any) -> list[float]:
        """Measured driver angles, positive = open."""
        return data.qpos[self._qpos].tolist()

    def velocities_rad_s(self, data: Any) -> list[float]:
        """Measured driver speeds, positive = opening."""
        return data.qvel[self._dof].tolist()

    def currents_a(self, data: Any) -> list[float]:
        """Measured motor currents: torque over torque constant, positive = opening."""
        return (data.actuator_force[self._control] / MOTOR_TORQUE_NM_PER_A).tolist()

    def opening_m(self, data: Any) -> float:
        """Distance between the pads, below zero when they press together."""
        left, right = self.positions_rad(data)
        return 0.5 * (opening_m(left) + opening_m(right))
