"""Our retargeter beside Pink and mink: speed and accuracy at equal limits, in one process.

Run: python -m benchmarks.retarget [--seeds 3] [--ticks 600]

All retargeters take every tick in turn. A time is the processor time of one call: target in, joint
positions and velocities out. The robots are compared without head task and collision pairs, which
the others have not been given; what those cost is a table of its own.
"""

from __future__ import annotations

import argparse
import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import logging
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from benchmarks.machine import describe_machine
from benchmarks.retarget_costs import print_costs
from benchmarks.retarget_motions import KINDS, Kind, find_seeds, make_motion
from benchmarks.retarget_peers import INSTALL_MINK, MinkPeer, PinkPeer
from benchmarks.retarget_runs import Entry, Ours, Run, pool, run_in_turn
from benchmarks.retarget_workspaces import print_workspaces
from common.robots import CollisionSpec, load_robot
from services.retarget.robot_model import RobotModel

ROBOTS = ("panda", "gr1")
"""The one with the fewest joints and the one with the most."""

OURS = "ours"
FED_FORWARD = "ours, feed-forward"
PINK_PIQP = "Pink, PIQP"
PINK_DAQP = "Pink, DAQP"
MINK = "mink, DAQP, no acc. limit"

Table = dict[tuple[str, Kind], dict[str, Run]]
"""Runs by robot, motion and retargeter."""


@dataclass(frozen=True)
class Goal:
    """A figure that is to be reached."""

    what: str
    value: float
    most: float
    unit: str = "x"

    def __str__(self) -> str:
        verdict = "met" if self.value <= self.most else "MISSED"
        return f"  {self.what:62}{self.value:7.2f} {self.unit:2}  goal {self.most:4.2f}  {verdict}"


def describe_mink() -> str | None:
    """Version of mink, or None when it is not installed."""
    try:
        return version("mink")
    except PackageNotFoundError:
        return None


def load_bare_robot(name: str) -> RobotModel:
    """A robot without what the others cannot do: head task, walls, collision pairs."""
    spec = load_robot(name)
    return RobotModel(
        spec.model_copy(update={"head": None, "walls": (), "collision": CollisionSpec()})
    )


def compare(model: RobotModel, kind: Kind, *, seeds: list[int], ticks: int) -> dict[str, Run]:
    """All retargeters on one kind of motion."""
    T_world_start = model.compute_tool_pose(np.array(model.spec.start_positions))
    runs: list[dict[str, Run]] = []
    for seed in seeds:
        motion = make_motion(kind, T_world_start, seed=seed, ticks=ticks)
        entries: dict[str, Entry] = {
            OURS: (Ours(model), motion.targets),
            FED_FORWARD: (Ours(model), motion.fed_forward),
            PINK_PIQP: (PinkPeer(model, solver="piqp"), motion.targets),
            PINK_DAQP: (PinkPeer(model, solver="daqp"), motion.targets),
        }
        if describe_mink():
            entries[MINK] = (MinkPeer(model, solver="daqp"), motion.targets)
        # Beyond a limit, Pink takes the root of a negative distance; the failure is counted.
        with np.errstate(invalid="ignore"):
            runs.append(run_in_turn(model, motion, entries))
    return {name: pool([run[name] for run in runs]) for name in runs[0]}


def print_table(table: Table, robot: str, title: str, cell: str) -> None:
    """One row per retargeter, one column per motion."""
    print(f"\n{robot}: {title}")
    print(f"  {'':26}" + "".join(f"{kind:>18}" for kind in KINDS))
    for name in table[robot, KINDS[0]]:
        cells = [_format(table[robot, kind][name], cell) for kind in KINDS]
        print(f"  {name:26}" + "".join(f"{text:>18}" for text in cells))
    if MINK not in table[robot, KINDS[0]]:
        print(f"  {MINK:26}  not installed: {INSTALL_MINK}")


def _format(run: Run, cell: str) -> str:
    if cell == "time":
        p99 = float(np.percentile(run.times_us, 99))
        return f"{run.median_us:.0f} ({p99 / run.median_us:.1f})"
    if cell == "error":
        failures = f" ({run.failures})" if run.failures else ""
        return f"{1e3 * run.rms_m:.1f}/{1e3 * run.rms_rad:.1f}{failures}"
    return f"{run.peak_acceleration:.2f}"


def list_speed_goals(table: Table) -> Iterator[Goal]:
    """Ratios of medians: geometric mean over robots and motions."""
    yield Goal("speed, all steps, of Pink with PIQP", _compare_speed(table, PINK_PIQP), 0.65)
    yield Goal("speed, all steps, of Pink with DAQP", _compare_speed(table, PINK_DAQP), 1.10)
    what = "speed, steps without saturation, of Pink with DAQP"
    yield Goal(what, _compare_unsaturated(table, PINK_DAQP), 0.85)
    tails = [
        float(np.percentile(runs[OURS].times_us, 99)) / runs[OURS].median_us
        for runs in table.values()
    ]
    yield Goal("p99 over median of ours, geometric mean", _geometric_mean(tails), 2.5)


def _compare_speed(table: Table, other: str) -> float:
    return _geometric_mean(
        [runs[OURS].median_us / runs[other].median_us for runs in table.values()]
    )


def _compare_unsaturated(table: Table, other: str) -> float:
    ratios: list[float] = []
    for robot in ROBOTS:
        ours = pool([table[robot, kind][OURS] for kind in KINDS])
        theirs = pool([table[robot, kind][other] for kind in KINDS])
        free = np.logical_not(ours.saturated)
        ratios.append(float(np.median(ours.times_us[free]) / np.median(theirs.times_us[free])))
    return _geometric_mean(ratios)


def list_accuracy_goals(table: Table) -> Iterator[Goal]:
    """Position errors beside the better of Pink's two solvers, each robot and both together."""
    comparisons: tuple[tuple[str, Kind, str, float], ...] = (
        ("set-points, interpolated", "set-points", FED_FORWARD, 0.3),
        ("set-points, held", "set-points", OURS, 0.3),
        ("fast, same targets", "fast", OURS, 0.75),
        ("near limits, same targets", "near limits", OURS, 0.75),
    )
    for what, kind, name, most in comparisons:
        ratios = [_compare_error(table[robot, kind], name) for robot in ROBOTS]
        for robot, ratio in zip(ROBOTS, ratios, strict=True):
            yield Goal(f"error, {what}, {robot}", ratio, most)
        yield Goal(f"error, {what}, geometric mean", _geometric_mean(ratios), most)
    for robot in ROBOTS:
        sine_mm = 1e3 * table[robot, "sine"][FED_FORWARD].rms_m
        yield Goal(f"error, sine with feed-forward, {robot}", sine_mm, 3.5, "mm")


def _compare_error(runs: dict[str, Run], name: str) -> float:
    return runs[name].rms_m / min(runs[PINK_PIQP].rms_m, runs[PINK_DAQP].rms_m)


def _geometric_mean(values: Sequence[float]) -> float:
    return math.exp(sum(map(math.log, values)) / len(values))


def main() -> None:
    parser = argparse.ArgumentParser(prog="benchmarks.retarget", description=__doc__)
    parser.add_argument("--seeds", type=int, default=3, help="motions of each kind")
    parser.add_argument("--ticks", type=int, default=600, help="length of a motion")
    args = parser.parse_args()
    # Pink and mink log every joint that is outside its range, tick after tick.
    logging.disable(logging.WARNING)

    print(describe_machine(["pin", "piqp", "qpsolvers", "daqp", "pin-pink", "scipy", "numpy"]))
    print(f"mink {describe_mink() or f'not installed: {INSTALL_MINK}'}")
    models = {name: load_bare_robot(name) for name in ROBOTS}
    seeds = {
        name: find_seeds(model, count=args.seeds, ticks=args.ticks)
        for name, model in models.items()
    }
    table: Table = {
        (name, kind): compare(model, kind, seeds=seeds[name], ticks=args.ticks)
        for name, model in models.items()
        for kind in KINDS
    }
    for name, model in models.items():
        robot = f"{name} ({model.spec.nv} joints)"
        print(f"\n== {robot}, {args.ticks} ticks, motions {seeds[name]} of each kind")
        shares = (f"{kind} {table[name, kind][OURS].saturated.mean():.0%}" for kind in KINDS)
        print(f"ticks of ours with a joint at a bound: {', '.join(shares)}")
        print_table(table, name, "median us of a step (p99 / median)", "time")
        print_table(table, name, "error, rms mm/mrad (no solution)", "error")
        print_table(table, name, "largest acceleration / limit", "acceleration")
    print("\n== goals; ratios of medians and of position errors, ours / theirs")
    for goal in (*list_speed_goals(table), *list_accuracy_goals(table)):
        print(goal)
    print_workspaces(list(models.values()), ticks=1000)
    print_costs(load_robot(ROBOTS[-1]), ticks=args.ticks)


if __name__ == "__main__":
    main()
