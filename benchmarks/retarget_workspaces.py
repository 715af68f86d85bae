"""Whether steps allocate: workspaces of solvers that are set up, memory that stays."""

from __future__ import annotations

import tracemalloc
from collections.abc import Sequence
from typing import Any
from unittest import mock

import numpy as np
import piqp

from benchmarks.retarget_motions import KINDS, make_motion
from benchmarks.retarget_runs import Ours
from services.retarget.reference import TickReference
from services.retarget.robot_model import RobotModel


def print_workspaces(models: Sequence[RobotModel], *, ticks: int) -> None:
    """Print how many workspaces one retargeter sets up, when, and how much memory stays."""
    print(f"\n== solver workspaces, all motions after one another, {ticks} ticks each")
    for model in models:
        first, later = _count_setups(model, ticks=ticks)
        verdict = "met" if later == 0 else "MISSED"
        print(
            f"  {model.spec.name:6} set up before or in the first step: {first}, later: {later}"
            f"  goal 0  {verdict}; left behind: {_measure_growth(model, ticks=ticks)} bytes"
        )


def _count_setups(model: RobotModel, *, ticks: int) -> tuple[int, int]:
    """Set-ups until the end of the first step, and after it."""
    setups = 0

    class CountingSolver(piqp.DenseSolver):
        def setup(self, *args: Any, **kwargs: Any) -> None:
            nonlocal setups
            setups += 1
            super().setup(*args, **kwargs)

    with mock.patch.object(piqp, "DenseSolver", CountingSolver):
        ours = Ours(model)
        references = _list_references(model, ticks=ticks)
        ours.step(references[0])
        first = setups
        for reference in references[1:]:
            ours.step(reference)
    return first, setups - first


def _measure_growth(model: RobotModel, *, ticks: int) -> int:
    """Bytes of Python's and numpy's memory that are held more after the second pass than before."""
    ours = Ours(model)
    references = _list_references(model, ticks=ticks)
    for reference in references:
        ours.step(reference)
    tracemalloc.start()
    ours.step(references[0])
    before, _ = tracemalloc.get_traced_memory()
    for reference in references:
        ours.step(reference)
    after, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return after - before


def _list_references(model: RobotModel, *, ticks: int) -> list[TickReference]:
    T_world_start = model.compute_tool_pose(np.array(model.spec.start_positions))
    return [
        reference
        for kind in KINDS
        for reference in make_motion(kind, T_world_start, seed=0, ticks=ticks).targets
    ]
