"""Where the tool really was, tick by tick, in a file: what it says does not depend on the bus."""

from __future__ import annotations

import csv
from pathlib import Path
from types import TracebackType
from typing import Self

from common.clock import TICK_S
from common.errors import NotWritable
from common.messages import SafetyStatus
from common.se3 import pose_to_wire
from services.sim.world import World

COLUMNS = (
    *("t_mono_ns", "epoch", "tick", "t_sim_s", "status"),
    *("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz"),
)


class ToolLog:
    """Appends one line per tick to a CSV file, and writes it out at once. Close it at the end.

    Args:
        path: The file; one that exists is replaced.

    Raises:
        NotWritable: It cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        try:
            # Line by line: whoever reads along must see a tick when it has happened.
            self._file = path.open("w", newline="", buffering=1)
        except OSError as error:
            raise NotWritable(str(path), error.strerror or str(error)) from error
        self._writer = csv.writer(self._file, lineterminator="\n")
        self._writer.writerow(COLUMNS)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()

    def add(
        self, world: World, status: SafetyStatus, *, t_mono_ns: int, epoch: int, tick: int
    ) -> None:
        """Write T_world_tool at the end of a tick.

        Args:
            world: The world after its physics steps.
            status: What its guard did in the tick.
            t_mono_ns: This machine's monotonic clock.
            epoch: Of the episode.
            tick: The tick, counted on after the episode's end.
        """
        pose = [f"{value:.7f}" for value in pose_to_wire(world.T_world_tool)]
        t_sim = f"{(tick + 1) * TICK_S:.2f}"
        self._writer.writerow([t_mono_ns, epoch, tick, t_sim, status, *pose])
