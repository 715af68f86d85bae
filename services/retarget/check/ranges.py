"""Ranges: every joint has limits, and starts and rests well inside of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common.se3 import Array
from services.retarget.check.report import Finding, Value, judge
from services.retarget.robot_model import RobotModel

LEAST_MARGIN = 0.01
"""Distance of start and bias from the nearest limit, as a share of the joint's range."""


def check_ranges(model: RobotModel) -> list[Finding]:
    """Limits of position, start and bias within them, limits of velocity and acceleration."""
    joints = model.spec.joints
    unlimited = [
        joint.name
        for joint, span in zip(joints, (model.upper - model.lower).tolist(), strict=True)
        if not np.isfinite(span)
    ]
    text = f"all {len(joints)} joints have a range"
    if unlimited:
        text = f"no range in model.xml: {', '.join(unlimited)}"
    limits = Finding(
        group="ranges",
        name="limits",
        status=judge(not unlimited),
        text=text,
        values={"joints": len(joints), "unlimited": len(unlimited)},
    )
    return [
        limits,
        _check_margin(model, "start", np.array([joint.start for joint in joints])),
        _check_margin(model, "bias", np.array([joint.bias for joint in joints])),
        _check_speeds(model),
    ]


def unit_of(model: RobotModel, joint: int) -> str:
    """`rad` of a hinge, `m` of a slide."""
    prismatic = model.pin.joints[joint + 1].shortname().startswith("JointModelPrismatic")
    return "m" if prismatic else "rad"


@dataclass(frozen=True)
class Margin:
    """How near a joint is to a limit."""

    joint: str
    distance: float
    """[rad, m]"""
    share: float
    """The same as a share of the joint's range."""
    text: str


def rank_margins(model: RobotModel, distances: Array) -> list[Margin]:
    """Sort joints by their distance (n,) [rad, m] from a limit, as a share of their range."""
    span = model.upper - model.lower
    shares = np.divide(distances, span, out=np.full_like(span, np.inf), where=np.isfinite(span))
    margins: list[Margin] = []
    for index in np.argsort(shares).tolist():
        joint, distance = model.spec.joints[index].name, float(distances[index])
        share = float(shares[index])
        text = f"{joint} {distance:.3f} {unit_of(model, index)} ({share:.0%} of its range)"
        margins.append(Margin(joint, distance, share, text))
    return margins


def _check_margin(model: RobotModel, name: str, q: Array) -> Finding:
    nearest = rank_margins(model, np.minimum(q - model.lower, model.upper - q))[0]
    good = nearest.share >= LEAST_MARGIN
    text = f"nearest to a limit: {nearest.text}"
    return Finding(
        group="ranges",
        name=name,
        status=judge(good),
        text=text if good else f"{text}, expected at least {LEAST_MARGIN:.0%}",
        values={"joint": nearest.joint, "margin": nearest.distance, "share": nearest.share},
    )


def _check_speeds(model: RobotModel) -> Finding:
    """Time and way that the slowest joint brakes for: v / a and v^2 / (2 a)."""
    joint = max(model.spec.joints, key=lambda each: each.velocity_limit / each.acceleration_limit)
    time_s = joint.velocity_limit / joint.acceleration_limit
    index = model.spec.joints.index(joint)
    way = 0.5 * joint.velocity_limit * time_s
    text = (
        f"all joints have limits of velocity and acceleration; longest to brake is {joint.name}: "
        f"{time_s:.2f} s, {way:.2f} {unit_of(model, index)}"
    )
    values: dict[str, Value] = {"joint": joint.name, "braking_s": time_s, "braking": way}
    return Finding(group="ranges", name="speeds", status="ok", text=text, values=values)
