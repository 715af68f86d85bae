"""`legato robot list` and `legato robot check`."""

from __future__ import annotations

import dataclasses
import json
import sys

from client.commands import RobotCheck, RobotList
from client.failures import format_error
from client.robots import check_robot, find_robot, summarize_robot
from client.tables import format_table
from common.errors import ModelError
from common.robots import list_robots, load_robot


def show_all(command: RobotList) -> int:
    """Show every robot; one that cannot be read is told and hides no other."""
    summaries, problems = [], list[ModelError]()
    for name in list_robots():
        try:
            summaries.append(summarize_robot(load_robot(name)))
        except ModelError as error:
            problems.append(error)
    if command.json:
        shown = {
            "robots": [dataclasses.asdict(summary) for summary in summaries],
            "problems": [problem.describe() for problem in problems],
        }
        sys.stdout.write(json.dumps(shown) + "\n")
    else:
        rows = [
            (
                *(summary.name, summary.title, summary.kind, str(summary.joints)),
                f"{summary.mass_kg:.1f}",
                "any" if summary.reach_m is None else f"{summary.reach_m:.2f}",
            )
            for summary in summaries
        ]
        headers = ("robot", "title", "kind", "joints", "mass kg", "reach m")
        sys.stdout.write(format_table(headers, rows) + "\n")
    for problem in problems:
        sys.stderr.write(format_error(problem) + "\n")
    return 1 if problems else 0


def check(command: RobotCheck) -> int:
    """Check one robot and tell what was found."""
    report = check_robot(find_robot(command.robot))
    if command.json:
        sys.stdout.write(json.dumps(report.to_json(), allow_nan=False) + "\n")
    else:
        sys.stdout.write(report.to_text())
    return 1 if report.problems else 0
