"""All checks of one robot, and what a list says about it."""

from __future__ import annotations

from dataclasses import dataclass

from common.robots import RobotSpec
from common.robots.compile import compile_robot
from services.retarget.check.kinematics import check_kinematics
from services.retarget.check.legs import check_legs
from services.retarget.check.margins import check_margins
from services.retarget.check.masses import check_masses
from services.retarget.check.ranges import check_ranges
from services.retarget.check.reach import check_reach, measure_reach
from services.retarget.check.report import Finding, RobotReport
from services.retarget.model import build_pinocchio_model
from services.retarget.robot_model import RobotModel


@dataclass(frozen=True, kw_only=True)
class RobotSummary:
    """One robot in few words."""

    name: str
    title: str
    kind: str
    joints: int
    """Joints that the retargeter moves."""
    mass_kg: float
    """Without the gripper."""
    reach_m: float | None
    """How far from the world's z axis its pads get; None for a free hand, which gets anywhere."""


def check_robot(spec: RobotSpec) -> RobotReport:
    """Look at everything that can be known of a robot without its simulation.

    Raises:
        BadRobotFile: A file that nothing can be made of; names the body or joint.
        ModelMismatch: The two models differ by more than rounding.
    """
    findings = _check_free_hand(spec) if spec.kind == "free_hand" else _check_joints(spec)
    return RobotReport(robot=spec.name, title=spec.title, findings=findings)


def summarize_robot(spec: RobotSpec) -> RobotSummary:
    """The row of a robot in a list.

    Raises:
        BadRobotFile: A file that nothing can be made of.
        ModelMismatch: The two models differ.
    """
    if spec.kind == "free_hand":
        mj, reach_m = compile_robot(spec), None
    else:
        model = RobotModel(spec)
        mj, reach_m = model.mj, measure_reach(model)
    return RobotSummary(
        name=spec.name,
        title=spec.title,
        kind=spec.kind,
        joints=len(spec.joints),
        mass_kg=float(mj.body_mass[1:].sum()),
        reach_m=reach_m,
    )


def _check_joints(spec: RobotSpec) -> list[Finding]:
    model = RobotModel(spec)
    # RobotModel's own is without legs.
    whole = build_pinocchio_model(model.mj, robot=spec.name)
    return [
        *check_kinematics(model.mj, whole, tool_site=spec.tool_site),
        *check_ranges(model),
        *check_masses(model.mj, whole),
        *(check_legs(model) if spec.legs else [_skip("legs", "it has none")]),
        *check_reach(model),
        *check_margins(model),
    ]


def _check_free_hand(spec: RobotSpec) -> list[Finding]:
    masses = check_masses(compile_robot(spec), None)
    no_joints = "a free hand has no joints"
    return [
        *(_skip(group, no_joints) for group in ("kinematics", "ranges")),
        *masses,
        *(_skip(group, no_joints) for group in ("legs", "reach", "margins")),
    ]


def _skip(group: str, text: str) -> Finding:
    return Finding(group=group, name="-", status="skipped", text=text)
