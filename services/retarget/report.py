"""What is measured every tick, gathered into one status message per frame period."""

from __future__ import annotations

from typing import NamedTuple

from common.clock import FRAME_TICKS, closes_frame
from common.messages import Header, RetargetStatus
from common.se3 import Array, distance, pose_to_wire
from services.retarget.retargeter import Motion


class TickRecord(NamedTuple):
    """One tick.

    Args:
        T_world_reference: (4, 4) reference that the tool should be at by now.
        T_world_tool: (4, 4) measured tool pose at the start of the tick.
        motion: What the retargeter answered.
        solve_time_s: How long it took [s].
    """

    T_world_reference: Array
    T_world_tool: Array
    motion: Motion
    solve_time_s: float


class FrameReport:
    """Gathers ticks; gives a `RetargetStatus` at the end of every frame period."""

    def __init__(self) -> None:
        self._failures = 0
        self._ticks: list[TickRecord] = []

    def add(self, tick: TickRecord, header: Header) -> RetargetStatus | None:
        """Take one tick; give the status of the ticks gathered when the period ends.

        In real time ticks can be missed, the last of a period too: then ten of them are enough.

        Args:
            tick: What happened.
            header: Of the state that was answered.
        """
        self._ticks.append(tick)
        self._failures += tick.motion.failures
        if not closes_frame(header.step) and len(self._ticks) < FRAME_TICKS:
            return None
        ticks, self._ticks = self._ticks, []
        errors = [distance(t.T_world_reference, t.T_world_tool) for t in ticks]
        levels = zip(*(t.motion.scaling for t in ticks), strict=True)
        active = dict.fromkeys(name for t in ticks for name in t.motion.active_limits)
        return RetargetStatus(
            header=header,
            for_step=header.step,
            request_t_mono_ns=header.t_mono_ns,
            T_world_reference=pose_to_wire(tick.T_world_reference),
            T_world_tool=pose_to_wire(tick.T_world_tool),
            hand_error_m=[error_m for error_m, _ in errors],
            hand_error_rad=[error_rad for _, error_rad in errors],
            solve_time_s=[t.solve_time_s for t in ticks],
            hand_scaling=[t.motion.scaling[0] for t in ticks],
            scaling=[min(level) for level in levels],
            active_limits=list(active),
            limited_ticks=sum(1 for t in ticks if t.motion.active_limits),
            solver_failures=self._failures,
        )
