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
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from client.failures import exit_code_of, format_error
from client.tables import format_table
from common.errors import LegatoError, MissingExtra, UnknownName
from common.robots import RobotSpec, list_robots, load_robot
from common.se3 import Array
from common.tasks import Obstacle, load_task
from common.tasks.recording import Recording, load_recording
from services.retarget.recorded_run import Run, follow_recording
from services.retarget.robot_model import RobotModel

REST_TICKS = 50
"""After the last set-point."""


def follow(model: RobotModel, recording: Recording, obstacles: Sequence[Obstacle]) -> Run:
    """A robot along a recording, until it rests."""
    return follow_recording(model, recording, obstacles, rest_ticks=REST_TICKS)


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
