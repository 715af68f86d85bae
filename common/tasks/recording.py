"""Recorded demonstrations: where the gripper was wanted ten times a second, and its grasp.

One CSV file per task. Columns: t_s; the set-point x y z [m] and qw qx qy qz in the world; grasp
(1 = close), commanded on the way there. `python -m tests.recordings` makes them.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from common.clock import FRAME_TICKS, TICK_S
from common.errors import InvalidValue, UnknownName
from common.messages import ActionStep
from common.se3 import Array, differential, pose_from_wire

RECORDINGS_FOLDER = Path(__file__).with_name("recorded")
COLUMNS = ("t_s", "x", "y", "z", "qw", "qx", "qy", "qz", "grasp")
PERIOD_S = FRAME_TICKS * TICK_S

_UNIT_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Recording:
    """One demonstration.

    Args:
        task: Which task it is of.
        T_world_setpoint: (4, 4) set-points, 0.1 s apart; the first is where the tool starts.
        grasp: With each set-point, whether the fingers are told to close.
    """

    task: str
    T_world_setpoint: tuple[Array, ...]
    grasp: tuple[bool, ...]

    def list_actions(self) -> list[ActionStep]:
        """The steps from each set-point to the next, in the frame of the first, as policies say."""
        pairs = zip(self.T_world_setpoint, self.T_world_setpoint[1:], strict=False)
        return [
            ActionStep(translation_m=d.tolist(), rotation_rad=w.tolist(), grasp=grasp)
            for (d, w), grasp in zip(
                (differential(*pair) for pair in pairs), self.grasp[1:], strict=True
            )
        ]


def list_recordings() -> list[str]:
    """Names of the tasks that have a recording."""
    return sorted(path.stem for path in RECORDINGS_FOLDER.glob("*.csv"))


def load_recording(task: str, *, folder: Path = RECORDINGS_FOLDER) -> Recording:
    """Read the recording of a task.

    Raises:
        UnknownName: The task has none.
        InvalidValue: The file is not as described above; names the line.
    """
    path = folder / f"{task}.csv"
    if not path.is_file():
        raise UnknownName("recording", task, list_recordings())
    with path.open(newline="") as file:
        header, *rows = list(csv.reader(file)) or [[]]
    if tuple(header) != COLUMNS or len(rows) < 2:
        expected = f"the columns {', '.join(COLUMNS)} and at least two lines"
        raise InvalidValue(path.name, ",".join(header), expected)
    numbers = [_read(path, index, row) for index, row in enumerate(rows)]
    return Recording(
        task=task,
        T_world_setpoint=tuple(pose_from_wire(row[1:8]) for row in numbers),
        grasp=tuple(row[8] == 1.0 for row in numbers),
    )


def _read(path: Path, index: int, row: Sequence[str]) -> list[float]:
    """The numbers of a line, if it is one."""
    expected = f"{len(COLUMNS)} numbers: t_s = {index * PERIOD_S:.1f}, a unit quaternion, 0 or 1"
    problem = InvalidValue(f"{path.name}, line {index + 2}", ",".join(row), expected)
    try:
        values = [float(cell) for cell in row]
    except ValueError as error:
        raise problem from error
    fits = (
        len(values) == len(COLUMNS)
        and all(math.isfinite(value) for value in values)
        and abs(values[0] - index * PERIOD_S) < 1e-6
        and abs(math.hypot(*values[4:8]) - 1.0) < _UNIT_TOLERANCE
        and values[8] in (0.0, 1.0)
    )
    if not fits:
        raise problem
    return values
