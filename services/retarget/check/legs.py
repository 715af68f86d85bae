"""Legs: over the whole range of the body every foot stays on its foothold."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeAlias

import mujoco
import numpy as np
import numpy.typing as npt

from common.errors import FootholdOutOfReach
from common.robots.compile import find_positions
from common.robots.leg import Leg, read_legs
from common.se3 import Array
from services.retarget.check.postures import bound_ranges
from services.retarget.check.report import Finding, Value, judge
from services.retarget.robot_model import RobotModel

FOOT_TOLERANCE_M = 1e-6
RANDOM_POSES = 300

_Mask: TypeAlias = npt.NDArray[np.bool_]


@dataclass
class _Leg:
    """What a leg has come to over the poses of the body."""

    name: str
    foot_error_m: float = 0.0
    margin_rad: float = float("inf")
    joint: str = ""
    problem: str = ""


def check_legs(model: RobotModel) -> list[Finding]:
    """Solve every leg at the corners of the body's range and at random poses in it.

    Raises:
        BadRobotFile: A leg is not built as the solution assumes.
    """
    mj, data = model.mj, mujoco.MjData(model.mj)
    legs = read_legs(mj, model.spec)
    seen = [_Leg(leg.name) for leg in legs]
    feet = [leg.foot_site for leg in model.spec.legs]
    bodies = [int(mj.body_parentid[int(mj.joint(leg.joints[0]).bodyid[0])]) for leg in legs]
    q = np.array(model.spec.start_positions)
    where = find_positions(model.spec, mj)
    poses = 0
    for body_q, mask in _list_body_poses(model, bodies):
        q[mask] = body_q
        data.qpos[where] = q
        mujoco.mj_kinematics(mj, data)
        poses += 1
        for leg, body, each in zip(legs, bodies, seen, strict=True):
            _place(mj, data, leg, body, each)
        mujoco.mj_kinematics(mj, data)
        for leg, site, each in zip(legs, feet, seen, strict=True):
            error_m = float(np.abs(data.site(site).xpos - leg.p_world_foot).max())
            each.foot_error_m = max(each.foot_error_m, error_m)
    return [_tell(each, poses) for each in seen]


def _place(mj: mujoco.MjModel, data: mujoco.MjData, leg: Leg, body: int, seen: _Leg) -> None:
    try:
        solution = leg.solve(data.xpos[body], data.xmat[body].reshape(3, 3))
    except FootholdOutOfReach as error:
        x, y, z = data.xpos[body].tolist()
        seen.problem = seen.problem or f"body at ({x:.3f}, {y:.3f}, {z:.3f}) m: {error.problem}"
        return
    for name, value, (lower, upper) in zip(leg.joints, solution, leg.ranges_rad, strict=True):
        data.qpos[mj.joint(name).qposadr[0]] = value
        margin = min(value - lower, upper - value)
        if margin < seen.margin_rad:
            seen.margin_rad, seen.joint = margin, name


def _list_body_poses(model: RobotModel, bodies: list[int]) -> Iterator[tuple[Array, _Mask]]:
    """Positions of the joints that move a hip, and which these are: (n,) mask."""
    above: set[int] = set()
    for body in bodies:
        while body:
            above.add(body)
            body = int(model.mj.body_parentid[body])
    mask = np.array(
        [int(model.mj.joint(joint.name).bodyid[0]) in above for joint in model.spec.joints]
    )
    lower, upper = bound_ranges(model.lower[mask], model.upper[mask])
    for corner in itertools.product(*zip(lower.tolist(), upper.tolist(), strict=True)):
        yield np.array(corner), mask
    random = np.random.default_rng(2)
    for _ in range(RANDOM_POSES):
        yield random.uniform(lower, upper), mask


def _tell(leg: _Leg, poses: int) -> Finding:
    values: dict[str, Value] = {"poses": poses}
    if leg.problem:
        return _finding(leg, False, leg.problem, values)
    values |= {
        "foot_error_m": leg.foot_error_m,
        "joint": leg.joint,
        "margin_rad": leg.margin_rad,
    }
    text = (
        f"{poses} poses of the body: foot at most {leg.foot_error_m:.1e} m off its foothold; "
        f"nearest to a limit is {leg.joint}: {leg.margin_rad:.3f} rad"
    )
    return _finding(leg, leg.foot_error_m <= FOOT_TOLERANCE_M, text, values)


def _finding(leg: _Leg, good: bool, text: str, values: dict[str, Value]) -> Finding:
    return Finding(group="legs", name=leg.name, status=judge(good), text=text, values=values)
