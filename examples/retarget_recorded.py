"""Retarget a recorded gripper trajectory to every robot, without simulation.

Run: python -m examples.retarget_recorded [--robot NAME ...] [--mode project|scale]
         [--recording FILE.csv] [--out FOLDER]

Every command is taken to be carried out exactly, so what is seen is the retargeter alone. The
recorded lid keeps the robots' links off its table; a recording of your own knows no table.
"""

from __future__ import annotations

import argparse
import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from client.failures import exit_code_of, format_error
from client.tables import format_table
from common.clock import FRAME_TICKS
from common.errors import LegatoError, MissingExtra, UnknownName
from common.robots import RobotSpec, list_robots, load_robot
from common.se3 import Array, distance
from common.tasks import Obstacle, load_task
from common.tasks.recording import Recording, load_recording
from services.retarget.reference import GripperReference
from services.retarget.robot_model import RobotModel
from services.retarget.whole_body import WholeBodyRetargeter

REST_TICKS = 50
"""After the last set-point."""


@dataclass(frozen=True)
class Run:
    """One robot along one recording.

    Args:
        model: The robot.
        q: (ticks, n) commanded joint positions [rad, m].
        error_m: (ticks,) distance of the hand from its reference.
        error_rad: (ticks,) the same of its orientation.
        scaling: (ticks, levels) share of hand, head where there is one, and posture achieved.
        held_back: (ticks,) whether a joint stood at a bound, or a wall or a link was in the way.
        times_s: (ticks,) how long each tick took.
        failures: Levels without solution.
    """

    model: RobotModel
    q: Array
    error_m: Array
    error_rad: Array
    scaling: Array
    held_back: Array
    times_s: Array
    failures: int


def follow(model: RobotModel, recording: Recording, obstacles: Sequence[Obstacle]) -> Run:
    """Give one set-point every ten ticks and note what the robot is told."""
    gains = model.spec.retarget
    retargeter = WholeBodyRetargeter(model, obstacles)
    reference = GripperReference(
        retargeter.T_world_hand, lead_m=gains.setpoint_lead_m, lead_rad=gains.setpoint_lead_rad
    )
    motions, errors, times_s = [], [], []
    actions = recording.list_actions()
    for tick in range(len(actions) * FRAME_TICKS + REST_TICKS):
        frame, since = divmod(tick, FRAME_TICKS)
        if since == 0 and frame < len(actions):
            reference.take([actions[frame]], retargeter.T_world_hand)
        wanted = reference.advance(retargeter.T_world_hand)
        started = time.perf_counter()
        motions.append(retargeter.follow(wanted))
        times_s.append(time.perf_counter() - started)
        errors.append(distance(wanted.T_world_end, retargeter.T_world_hand))
    error_m, error_rad = np.array(errors).T
    return Run(
        model=model,
        q=np.array([motion.positions for motion in motions]),
        error_m=error_m,
        error_rad=error_rad,
        scaling=np.array([motion.scaling for motion in motions]),
        held_back=np.array([bool(motion.active_limits) for motion in motions]),
        times_s=np.array(times_s),
        failures=sum(motion.failures for motion in motions),
    )


def format_runs(runs: Sequence[Run]) -> str:
    """One row per robot."""
    return format_table(
        (
            *("robot", "joints", "hand error mm: median", "p95", "max"),
            *("mrad: median", "p95", "max", "held back", "no solution", "median us"),
        ),
        [
            (
                *(run.model.spec.name, str(run.q.shape[1])),
                *_summarize(run.error_m),
                *_summarize(run.error_rad),
                *(f"{run.held_back.mean():.0%}", str(run.failures)),
                f"{1e6 * np.median(run.times_s):.0f}",
            )
            for run in runs
        ],
    )


def _summarize(errors: Array) -> list[str]:
    """Median, 95th percentile and largest of errors in thousandths."""
    return [f"{1e3 * value:.2f}" for value in np.quantile(errors, [0.5, 0.95, 1.0])]


def load_spec(name: str, mode: Literal["project", "scale"] | None) -> RobotSpec:
    """A robot with joints, in its own mode or another.

    Raises:
        UnknownName: There is none of this name.
    """
    known = [each for each in list_robots() if load_robot(each).kind == "joints"]
    if name not in known:
        raise UnknownName("robot with joints", name, known)
    spec = load_robot(name)
    gains = spec.retarget.model_copy(update={"mode": mode or spec.retarget.mode})
    return spec.model_copy(update={"retarget": gains})


def run(args: argparse.Namespace) -> None:
    """Retarget, print the table, draw a sheet per robot.

    Raises:
        LegatoError: A name, file or package is missing or wrong.
    """
    try:
        from examples.retarget_sheet import draw_sheet
    except ModuleNotFoundError as error:
        raise MissingExtra("matplotlib", "examples") from error
    if args.recording:
        path: Path = args.recording
        recording, obstacles = load_recording(path.stem, folder=path.parent), ()
    else:
        recording, obstacles = load_recording("lid"), load_task("lid").obstacles
    names = args.robot or [each for each in list_robots() if load_robot(each).kind == "joints"]
    specs = [load_spec(name, args.mode) for name in names]
    runs = [follow(RobotModel(spec), recording, obstacles) for spec in specs]
    sys.stdout.write(format_runs(runs) + "\n")
    args.out.mkdir(parents=True, exist_ok=True)
    for each in runs:
        path = args.out / f"retarget-{each.model.spec.name}.png"
        draw_sheet(each, title=f"{each.model.spec.title} · {recording.task}").savefig(path)
        sys.stdout.write(f"{path}\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line; 0 if all went well."""
    what, _, _ = (__doc__ or "").partition("\n")
    parser = argparse.ArgumentParser(prog="examples.retarget_recorded", description=what)
    parser.add_argument("--robot", action="append", metavar="NAME", help="may be repeated")
    parser.add_argument("--mode", choices=["project", "scale"], help="level 1, if not the robot's")
    parser.add_argument("--recording", type=Path, metavar="FILE.csv", help="another trajectory")
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FOLDER",
        default=Path("runs/retarget"),
        help="where the figures go (default: %(default)s)",
    )
    try:
        run(parser.parse_args(arguments))
    except LegatoError as error:
        sys.stderr.write(format_error(error) + "\n")
        return exit_code_of(error)
    return 0


if __name__ == "__main__":
    sys.exit(main())
