"""Margins: how near the joints come to their limits along recorded demonstrations."""

from __future__ import annotations

import numpy as np

from common.tasks import load_task
from common.tasks.recording import list_recordings, load_recording
from services.retarget.check.ranges import rank_margins
from services.retarget.check.report import Finding, judge
from services.retarget.recorded_run import Run, follow_recording
from services.retarget.robot_model import RobotModel

P95_LIMIT_M, P95_LIMIT_RAD = 0.005, 0.02
LARGEST_LIMIT_M, LARGEST_LIMIT_RAD = 0.020, 0.1
AT_LIMIT = 1e-3
"""What counts as standing at a limit [rad, m]."""
ROUNDING = 1e-9
NAMED = 3
"""Joints that the text names; the data has all."""

_REST_TICKS = 20
"""After the last set-point."""


def check_margins(model: RobotModel) -> list[Finding]:
    """Follow every recording from the start posture, without dynamics, and tell how it went."""
    findings: list[Finding] = []
    for task in list_recordings():
        run = follow_recording(
            model, load_recording(task), load_task(task).obstacles, rest_ticks=_REST_TICKS
        )
        findings += [_tell_margin(task, run), _tell_hand(task, run), _tell_bounds(task, run)]
    return findings


def _tell_margin(task: str, run: Run) -> Finding:
    """A joint may stand at its limit, and is named then, but not beyond it."""
    model = run.model
    distances = np.minimum(run.q - model.lower, model.upper - run.q)
    ranked = rank_margins(model, distances.min(axis=0))
    names = [joint.name for joint in model.spec.joints]
    at_limit = np.mean(distances <= AT_LIMIT, axis=0).tolist()
    stuck = {name: share for name, share in zip(names, at_limit, strict=True) if share}
    text = f"nearest to a limit: {', '.join(margin.text for margin in ranked[:NAMED])}"
    if stuck:
        told = (f"{name} {share:.1%}" for name, share in stuck.items())
        text += f"; share of time at a limit: {', '.join(told)}"
    return Finding(
        group="margins",
        name=f"{task} joints",
        status=judge(min(margin.distance for margin in ranked) >= -ROUNDING),
        text=text,
        values={
            "joint": ranked[0].joint,
            "margin": ranked[0].distance,
            "share": ranked[0].share,
            "margins": {margin.joint: margin.distance for margin in ranked},
            "at_limit_share": stuck,
        },
    )


def _tell_hand(task: str, run: Run) -> Finding:
    p95_m, largest_m = float(np.quantile(run.error_m, 0.95)), float(run.error_m.max())
    p95_rad, largest_rad = float(np.quantile(run.error_rad, 0.95)), float(run.error_rad.max())
    good = (p95_m <= P95_LIMIT_M and largest_m <= LARGEST_LIMIT_M) and (
        p95_rad <= P95_LIMIT_RAD and largest_rad <= LARGEST_LIMIT_RAD
    )
    text = (
        f"off its reference by {1e3 * p95_m:.2f} mm, {p95_rad:.4f} rad (p95), "
        f"{1e3 * largest_m:.2f} mm, {largest_rad:.4f} rad (largest)"
    )
    if not good:
        text += (
            f"; expected at most {1e3 * P95_LIMIT_M:g} mm, {P95_LIMIT_RAD:g} rad (p95), "
            f"{1e3 * LARGEST_LIMIT_M:g} mm, {LARGEST_LIMIT_RAD:g} rad (largest)"
        )
    return Finding(
        group="margins",
        name=f"{task} hand",
        status=judge(good),
        text=text,
        values={
            "p95_m": p95_m,
            "largest_m": largest_m,
            "p95_rad": p95_rad,
            "largest_rad": largest_rad,
        },
    )


def _tell_bounds(task: str, run: Run) -> Finding:
    share = float(np.mean(run.held_back))
    text = (
        f"{share:.0%} of ticks held back by a joint, wall or link; {run.failures} without solution"
    )
    return Finding(
        group="margins",
        name=f"{task} bounds",
        status=judge(run.failures == 0),
        text=text,
        values={"held_back_share": share, "failures": run.failures},
    )
