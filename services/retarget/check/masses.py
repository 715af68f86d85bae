"""Masses: totals of both models, and inertias that a body can have."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from services.retarget.check.report import Finding, Value, judge

MASS_TOLERANCE_KG = 1e-9
_TRIANGLE_TOLERANCE = 1e-9
"""Of the largest principal inertia."""


def check_masses(mj: mujoco.MjModel, whole: Any | None) -> list[Finding]:
    """Total, mass of each body, and the triangle inequality of its principal inertias.

    Args:
        mj: Compiled model of the robot, alone.
        whole: Pinocchio model of it, legs included; None for a free hand.
    """
    findings = [_check_bodies(mj), _check_inertias(mj)]
    total = float(mj.body_mass[1:].sum())
    values: dict[str, Value] = {"mass_kg": total}
    if whole is None:
        text = f"{total:.3f} kg, gripper not counted"
        return [_finding("total", True, text, values), *findings]
    difference = abs(sum(inertia.mass for inertia in whole.inertias) - total)
    values["difference_kg"] = difference
    text = (
        f"{total:.3f} kg, gripper not counted; Pinocchio and MuJoCo differ by {difference:.1e} kg"
    )
    good = difference <= MASS_TOLERANCE_KG and total > 0.0
    return [_finding("total", good, text, values), *findings]


def _check_bodies(mj: mujoco.MjModel) -> Finding:
    """Every mass at least 0, and more than 0 for a body that a joint moves."""
    masses = mj.body_mass[1:]
    names = [str(mj.body(body).name) for body in range(1, mj.nbody)]
    moved = mj.body_jntnum[1:] > 0
    # MuJoCo allows a moved body without mass when one that is fixed to it has some.
    bad = [
        name
        for name, mass, moves, subtree in zip(
            names, masses, moved, mj.body_subtreemass[1:], strict=True
        )
        if not mass >= 0.0 or (moves and not subtree > 0.0)
    ]
    if bad:
        return _finding("bodies", False, f"no positive mass: {', '.join(bad)}", {"bad": bad[0]})
    heavy = int(masses.argmax())
    light = int(np.where(masses > 0.0, masses, np.inf).argmin())
    values: dict[str, Value] = {
        "lightest": names[light],
        "lightest_kg": float(masses[light]),
        "heaviest": names[heavy],
        "heaviest_kg": float(masses[heavy]),
    }
    text = (
        f"{int((masses > 0.0).sum())} with mass, {masses[light]:.3g} kg ({names[light]}) "
        f"to {masses[heavy]:.3g} kg ({names[heavy]})"
    )
    return _finding("bodies", True, text, values)


def _check_inertias(mj: mujoco.MjModel) -> Finding:
    """Principal inertias A <= B <= C of every body with mass: A > 0 and A + B >= C."""
    bodies = [body for body in range(1, mj.nbody) if mj.body_mass[body] > 0.0]
    least, narrowest = float("inf"), ""
    for body in bodies:
        a, b, c = sorted(mj.body_inertia[body].tolist())
        slack = (a + b - c) / c if a > 0.0 else -1.0
        if slack < least:
            least, narrowest = slack, str(mj.body(body).name)
    good = least >= -_TRIANGLE_TOLERANCE
    text = f"A + B >= C for every body, with least to spare {narrowest}: {least:.2g} C"
    if not good:
        text = f"no body has the inertia of {narrowest}: A + B - C is {least:.2g} C"
    return _finding("inertias", good, text, {"body": narrowest, "slack": least})


def _finding(name: str, good: bool, text: str, values: dict[str, Value]) -> Finding:
    return Finding(group="masses", name=name, status=judge(good), text=text, values=values)
