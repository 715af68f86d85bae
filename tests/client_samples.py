"""Resources as the control plane answers them, for tests of the client."""

from __future__ import annotations

from datetime import UTC, datetime

from common.api import (
    Attempt,
    CellInfo,
    CellSummary,
    Evaluation,
    EvaluationRequest,
    ServiceInfo,
    StageCounts,
    Trial,
)
from common.errors import EmergencyStopped
from common.messages import (
    Distribution,
    Problem,
    SafetyCounts,
    StagesReached,
    TrialResult,
    WallTimes,
)

WHEN = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
SHA = "ab" * 32

# One black pixel.
PNG = bytes.fromhex(
    "89504e470d0a1a0a0000000d49484452000000010000000108000000003a7e9b55"
    "0000000a49444154789c63600000000200015e7d1f2d0000000049454e44ae426082"
)


def make_request(**fields) -> EvaluationRequest:
    values = {"tasks": ["lid"], "robots": ["abstract", "panda"], "policies": ["expert"]}
    return EvaluationRequest(**(values | {"trials": 2} | fields))


def make_result(*, outcome="success", reason="placed", failed=()) -> TrialResult:
    spread = Distribution(median=0.001, p95=0.004, p99=0.008, largest=0.01)
    return TrialResult(
        outcome=outcome,
        reason=reason,
        failed_conditions=list(failed),
        ticks=840,
        sim_time_s=8.4,
        wall_time_s=0.84,
        stages=StagesReached(
            grasped=True, lifted=True, placed=outcome == "success", released=outcome == "success"
        ),
        goal_distance_m=0.01,
        hand_error_m=spread,
        hand_error_rad=spread,
        hand_scaling_mean=0.998,
        hand_scaling_least=0.25,
        limited_share=0.125,
        solver_failures=0,
        solve_time_s=spread,
        inference_s=spread,
        wall_times=WallTimes(
            physics_s=0.1, camera_s=0.1, waiting_s=0.1, solve_s=0.1, inference_s=0.1
        ),
        held_ticks=0,
        missed_frames=0,
        resends=0,
        trace_sha256=SHA,
    )


def make_trial(identifier=0, *, robot="panda", index=0, status="success", **fields) -> Trial:
    ended = status in ("success", "failure")
    reason = {"success": "placed", "failure": "dropped the lid", "aborted": "panda left"}
    values = {
        "id": identifier,
        "evaluation": "e-1",
        "index": index,
        "task": "lid",
        "robot": robot,
        "policy": "expert",
        "seed": 7,
        "status": status,
        "reason": reason.get(status, ""),
        "attempts": [],
        "result": make_result(outcome=status, reason=reason[status]) if ended else None,
        "pictures": [],
    }
    return Trial(**(values | fields))


def make_attempt(**fields) -> Attempt:
    values = {
        "number": 1,
        "epoch": 3,
        "cell": "sim-0",
        "outcome": "aborted",
        "reason": "retarget-panda left",
        "started_at": WHEN,
        "finished_at": WHEN,
    }
    return Attempt(**(values | fields))


def make_cell(robot="panda", **fields) -> CellSummary:
    values = {
        "task": "lid",
        "robot": robot,
        "policy": "expert",
        "trials": 2,
        "done": 2,
        "successes": 1,
        "failures": 1,
        "aborted": 0,
        "success_rate": 0.5,
        "interval95": (0.095, 0.905),
        "stages": StageCounts(grasped=2, lifted=2, placed=1, released=1),
        "median_hand_error_m": 0.0012,
        "p95_hand_error_m": 0.0047,
        "mean_hand_scaling": 0.998,
        "least_hand_scaling": 0.25,
        "limited_share": 0.125,
        "solver_failures": 3,
        "median_solve_time_s": 0.00011,
        "p99_solve_time_s": 0.00042,
        "real_time_factor": 10.4,
        "trace_sha256": [SHA, None],
    }
    return CellSummary(**(values | fields))


def make_evaluation(**fields) -> Evaluation:
    values = {
        "id": "e-1",
        "status": "done",
        "request": make_request(),
        "created_at": WHEN,
        "finished_at": WHEN,
        "trials_total": 4,
        "trials_done": 4,
        "waiting_for": [],
        "cells": [make_cell("abstract"), make_cell("panda")],
        "versions": {"legato": "0.1.0"},
    }
    return Evaluation(**(values | fields))


def make_service(kind: str, node: str, *, alive=True) -> ServiceInfo:
    return ServiceInfo(
        kind=kind,
        node=node,
        alive=alive,
        code_version="0.1.0",
        packages={},
        host="here",
        pid=42,
        offers={"robots": ["panda"]} if kind == "retarget" else {},
        metrics={"handled": 12.0},
    )


def make_cell_info(cell: str = "sim-0", *, stopped: bool = False) -> CellInfo:
    fault = EmergencyStopped(cell, "rest", "too near")
    return CellInfo(
        cell=cell,
        alive=True,
        status="stopped",
        fault=Problem(**fault.describe()) if stopped else None,
        emergency_stop=stopped,
        counts=SafetyCounts(),
    )
