"""Stop time and drift, from the poses of the tool that the simulation wrote down itself."""

from __future__ import annotations

import csv
import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from common.clock import TICK_S
from common.se3 import Array, relative_rotation
from services.sim.tool_log import COLUMNS

REST_M_S = 0.01
REST_RAD_S = 0.05
"""Slower than both is at rest."""
STOP_LIMIT_S = 0.3
DRIFT_LIMIT_M = 0.002


@dataclass(frozen=True)
class Row:
    """One tick: when it was taken, in which episode, what the guard did, where the tool was."""

    t_mono_ns: int
    epoch: int
    status: str
    pose: tuple[float, ...]


@dataclass(frozen=True)
class Stop:
    """What a fault did to a moving tool.

    Args:
        speed_m_s: How fast it was when the fault came.
        stop_s: Simulated time from the fault until it was at rest for good.
        way_m: Distance from where the fault found it to where it came to rest.
        drift_m: Largest distance from where it was 0.3 s after the fault, later on.
        held_s: How long it was watched after that.
    """

    speed_m_s: float
    stop_s: float
    way_m: float
    drift_m: float
    held_s: float

    @property
    def good(self) -> bool:
        """Whether it is within the limits."""
        return self.stop_s <= STOP_LIMIT_S and self.drift_m <= DRIFT_LIMIT_M


def read_rows(path: Path, *, epoch: int, offset: int) -> list[Row]:
    """Ticks of one episode; a last line that is still being written is left out.

    Args:
        path: The tool log.
        epoch: Of the episode.
        offset: Size of the file when the episode began.
    """
    with path.open("rb") as file:
        file.seek(offset)
        text = file.read().decode()
    lines = text[: text.rfind("\n") + 1].splitlines()
    return [
        Row(
            int(row["t_mono_ns"]),
            epoch,
            row["status"],
            tuple(float(row[name]) for name in ("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz")),
        )
        for row in csv.DictReader(lines, fieldnames=COLUMNS)
        if int(row["epoch"]) == epoch
    ]


def measure_stop(poses: Sequence[Sequence[float]], fault: int) -> Stop:
    """What happened after a fault.

    Args:
        poses: T_world_tool per tick, `[x, y, z, qw, qx, qy, qz]`.
        fault: Index of the first tick that ended after the fault, at least 3.
    """
    p: Array = np.array([pose[:3] for pose in poses])
    speed_m_s = np.linalg.norm(np.diff(p, axis=0), axis=1) / TICK_S
    turn_rad_s = [
        float(np.linalg.norm(relative_rotation(_quat(a), _quat(b)))) / TICK_S
        for a, b in itertools.pairwise(poses)
    ]
    # Entry i is the motion in the tick that ended with pose i + 1.
    moving = [
        i + 1
        for i, (v, w) in enumerate(zip(speed_m_s, turn_rad_s, strict=True))
        if i + 1 >= fault and (v > REST_M_S or w > REST_RAD_S)
    ]
    ticks = moving[-1] - fault + 1 if moving else 0
    later = p[fault + round(STOP_LIMIT_S / TICK_S) :]
    return Stop(
        speed_m_s=float(speed_m_s[fault - 3 : fault].mean()),
        stop_s=ticks * TICK_S,
        way_m=float(np.linalg.norm(p[-1] - p[fault - 1])),
        drift_m=float(np.linalg.norm(later - later[0], axis=1).max()),
        held_s=(len(later) - 1) * TICK_S,
    )


def find_fault(rows: Iterable[Row], fault_ns: int) -> int:
    """Index of the first tick that ended after a moment of the monotonic clock."""
    return next(i for i, row in enumerate(rows) if row.t_mono_ns >= fault_ns)


def _quat(pose: Sequence[float]) -> tuple[float, float, float, float]:
    _, _, _, w, x, y, z = pose
    return w, x, y, z
