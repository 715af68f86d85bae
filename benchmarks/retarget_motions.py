"""Motions that retargeters are compared on: smooth, in steps, fast, far, and out of reach."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from common.clock import FRAME_TICKS, TICK_S
from common.se3 import Array, exp3, log3
from services.retarget.reference import TickReference, WaypointInterpolator
from services.retarget.robot_model import RobotModel

Kind = Literal["sine", "set-points", "fast", "near limits", "unreachable"]
KINDS: tuple[Kind, ...] = get_args(Kind)

_FADE_IN_S = 0.5
_RAMP_M = (0.7, 0.1, 0.2)
_RAMP_S = 3.0
_ITERATIONS = 3
_DAMPING = 1e-6
_REACHED = 1e-3


@dataclass(frozen=True)
class HandMotion:
    """Where the hand should be at the start of every tick, and what retargeters are told of it.

    Args:
        kind: Which motion.
        poses: (ticks + 1, 4, 4) T_world_hand at the ticks and at the end of the last one.
        targets: A pose for every tick, all that a retargeter without feed-forward is told.
        fed_forward: The same with velocities, interpolated where the targets are steps.
    """

    kind: Kind
    poses: Array
    targets: list[TickReference]
    fed_forward: list[TickReference]


def make_motion(kind: Kind, T_world_start: Array, *, seed: int, ticks: int) -> HandMotion:
    """A motion of sums of sinusoids about a start pose.

    x_i(t) = A_i (sin(2 pi f_i t + phi_i) - sin phi_i) min(1, t / 0.5 s), per axis, with amplitudes
    of 5 to 15 cm and 0.1 to 0.4 rad and frequencies of 0.15 to 0.5 Hz. `fast` has three times the
    frequency, `near limits` 2.2 and 2 times the amplitude, `unreachable` half the amplitude and a
    ramp to a point that no arm reaches.

    `set-points` are the smooth motion at 10 Hz. Each says where to be when the next one comes, as
    an action of a policy does. As targets they are held; fed forward they are interpolated.

    Args:
        kind: Which motion.
        T_world_start: (4, 4) hand pose at rest.
        seed: Of amplitudes, frequencies and phases.
        ticks: Length.
    """
    random = np.random.default_rng(seed)
    amplitude = np.concatenate([random.uniform(0.05, 0.15, 3), random.uniform(0.1, 0.4, 3)])
    frequency = random.uniform(0.15, 0.5, 6)
    phase = random.uniform(0.0, 2.0 * np.pi, 6)
    if kind == "fast":
        frequency *= 3.0
    elif kind == "near limits":
        amplitude *= [2.2, 2.2, 2.2, 2.0, 2.0, 2.0]
    elif kind == "unreachable":
        amplitude *= 0.5

    def pose(t_s: float) -> Array:
        wave = np.sin(2.0 * np.pi * frequency * t_s + phase) - np.sin(phase)
        x = amplitude * wave * min(1.0, t_s / _FADE_IN_S)
        T = T_world_start.copy()
        T[:3, 3] += x[:3]
        T[:3, :3] = exp3(x[3:]) @ T[:3, :3]
        if kind == "unreachable":
            T[:3, 3] += np.array(_RAMP_M) * min(1.0, t_s / _RAMP_S)
        return T

    poses = np.array([pose(tick * TICK_S) for tick in range(ticks + 1)])
    if kind == "set-points":
        setpoints = [
            pose((tick // FRAME_TICKS + 1) * FRAME_TICKS * TICK_S) for tick in range(ticks)
        ]
        return HandMotion(kind, poses, _hold(setpoints), _interpolate(T_world_start, setpoints))
    return HandMotion(kind, poses, _hold(list(poses[:-1])), _differentiate(poses))


def find_seeds(model: RobotModel, *, count: int, ticks: int) -> list[int]:
    """The first seeds whose smooth motion is within the robot's reach.

    A plain damped least-squares iteration within the joint ranges must follow it to 1 mm and
    1 mrad, at any speed. Faster and larger motions of these seeds may well ask for too much.
    """
    T_world_start = model.compute_tool_pose(np.array(model.spec.start_positions))
    seeds: list[int] = []
    for seed in itertools.count():
        motion = make_motion("sine", T_world_start, seed=seed, ticks=ticks)
        if _is_within_reach(model, motion.poses):
            seeds.append(seed)
        if len(seeds) == count:
            break
    return seeds


def _is_within_reach(model: RobotModel, poses: Array) -> bool:
    q = np.array(model.spec.start_positions)
    for T_world_wanted in poses:
        e = np.zeros(6)
        for _ in range(_ITERATIONS):
            T, J = model.compute_hand(q)
            e_R = log3(T_world_wanted[:3, :3] @ T[:3, :3].T)
            e = np.concatenate([T_world_wanted[:3, 3] - T[:3, 3], e_R])
            step = J.T @ np.linalg.solve(J @ J.T + _DAMPING * np.eye(6), e)
            q = np.clip(q + step, model.lower, model.upper)
        if np.abs(e).max() > _REACHED:
            return False
    return True


def _hold(targets: list[Array]) -> list[TickReference]:
    return [TickReference(T, T, np.zeros(6)) for T in targets]


def _interpolate(T_world_start: Array, setpoints: list[Array]) -> list[TickReference]:
    interpolator = WaypointInterpolator(T_world_start)
    references: list[TickReference] = []
    for tick, setpoint in enumerate(setpoints):
        if tick % FRAME_TICKS == 0:
            interpolator.aim(setpoint)
        references.append(interpolator.advance())
    return references


def _differentiate(poses: Array) -> list[TickReference]:
    return [
        TickReference(
            now,
            then,
            np.concatenate([then[:3, 3] - now[:3, 3], log3(then[:3, :3] @ now[:3, :3].T)]) / TICK_S,
        )
        for now, then in itertools.pairwise(poses)
    ]
