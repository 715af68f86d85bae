"""Reach: how much of the tasks' workspaces the hand gets to, and how far it gets at all."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from common.calibration.four_bar import PADS_TOUCH_RAD, pad_centre_x_m
from common.se3 import Array, exp3, make_pose
from common.tasks.workspaces import REGIONS, Region
from services.retarget.check.inverse import REACHED_M, REACHED_RAD, InverseKinematics
from services.retarget.check.report import Finding, judge
from services.retarget.robot_model import RobotModel

TABLE_HEIGHT_M = 0.82
"""Height at which the largest reach is told: above the tables of all tasks."""

_HEADINGS_RAD = [math.radians(each) for each in (-60, -30, 0, 30, 60)]
_STARTS = 16
"""Random postures for a pose that seems out of reach; 12 find as many poses as 48 do."""
_NEAREST_M, _FARTHEST_M, _STRIDE_M = 0.4, 2.0, 0.02


def check_reach(model: RobotModel, regions: Sequence[Region] = REGIONS) -> list[Finding]:
    """For every region: the share of its points, and of all its poses, that the hand reaches.

    Joint limits are kept, collisions are not looked at. A region is reachable when every point is
    reached with at least one of the hand's turns.
    """
    inverse = InverseKinematics(model, starts=_STARTS)
    return [_check_region(inverse, region) for region in regions]


def measure_reach(model: RobotModel) -> float:
    """Largest distance of the pads from the world's z axis [m], hand level and pointing outwards.

    At 0.82 m above the floor, the best of five headings within 60 degrees of straight ahead.
    """
    inverse = InverseKinematics(model, starts=2)
    return max(_walk_out(inverse, heading) for heading in _HEADINGS_RAD)


def _check_region(inverse: InverseKinematics, region: Region) -> Finding:
    objects, turns = region.list_objects(), region.list_turns()
    found: list[Array] = []
    per_object: list[int] = []
    for T_world_object in objects:
        reached = 0
        for turn in turns:
            q = inverse.solve(region.place_tool(T_world_object, turn), near=found[-1:])
            if q is not None:
                found.append(q)
                reached += 1
        per_object.append(reached)
    points = sum(reached > 0 for reached in per_object)
    poses, all_poses = sum(per_object), len(objects) * len(turns)
    text = (
        f"{points} of {len(objects)} points, {poses} of {all_poses} poses ({poses / all_poses:.0%})"
    )
    if points < len(objects):
        x, y, _ = objects[per_object.index(0)][:3, 3].tolist()
        text += f"; not with the object at x {x:.3f}, y {y:.3f} m"
    return Finding(
        group="reach",
        name=f"{region.task} {region.name}",
        status=judge(points == len(objects)),
        text=text,
        values={
            "points_share": points / len(objects),
            "poses_share": poses / all_poses,
            "tolerance_m": REACHED_M,
            "tolerance_rad": REACHED_RAD,
        },
    )


def _walk_out(inverse: InverseKinematics, heading_rad: float) -> float:
    """Farthest radius [m] along a heading: strides from near to far until one fails."""
    R = exp3([0.0, 0.0, heading_rad])
    ahead_m = pad_centre_x_m(PADS_TOUCH_RAD)
    farthest, near = 0.0, list[Array]()
    for radius in np.arange(_NEAREST_M, _FARTHEST_M, _STRIDE_M).tolist():
        p = R @ [radius - ahead_m, 0.0, 0.0] + [0.0, 0.0, TABLE_HEIGHT_M]
        q = inverse.solve(make_pose(R, p), near)
        if q is not None:
            farthest, near = radius, [q]
        elif near:
            break
    return farthest
