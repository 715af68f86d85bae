"""`python -m benchmarks.safe_stop`: every robot, every fault, in real time over processes.

The expert does the lid task; while the tool moves at 0.15 m/s or more, a process is killed or
stopped. Read from the tool log of the simulation, which goes on without a bus.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from benchmarks.machine import describe_machine
from benchmarks.safe_stop.cell import FAULTS, NeverMoved, open_cell
from client.tables import format_table
from common.robots import list_robots


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.safe_stop", description=__doc__)
    parser.add_argument("--robot", action="append", choices=list_robots(), help="default: all")
    parser.add_argument("--fault", action="append", choices=FAULTS, help="default: all")
    args = parser.parse_args()
    robots = args.robot or list_robots()
    rows: list[tuple[str, ...]] = []
    failures = 0
    with tempfile.TemporaryDirectory() as folder, open_cell(Path(folder), robots) as cell:
        for robot in robots:
            for fault in args.fault or FAULTS:
                try:
                    measured = cell.measure(robot, fault)
                except NeverMoved as error:
                    failures += 1
                    rows.append((robot, fault, *["-"] * 5, str(error)))
                    continue
                stop = measured.stop
                failures += not stop.good
                rows.append(
                    (
                        *(robot, fault, f"{stop.speed_m_s:.2f}", f"{stop.stop_s:.2f}"),
                        *(f"{1e3 * stop.way_m:.1f}", f"{1e3 * stop.drift_m:.2f}"),
                        *(str(measured.attempts), "yes" if stop.good else "NO"),
                    )
                )
    print(describe_machine(["mujoco-core", "eclipse-zenoh"]))
    heads = ("robot", "fault", "m/s", "rest after s", "way mm", "drift mm", "episodes", "good")
    print(format_table(heads, rows))
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
