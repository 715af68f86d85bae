"""Why a robot was stopped and may not move."""

from __future__ import annotations

from common.errors.base import LegatoError


class SafetyError(LegatoError):
    """Why a robot was stopped and may not move."""

    code = "E-SAFETY"
    http_status = 409


class EmergencyStopped(SafetyError):
    """Somebody pressed the emergency stop of a cell."""

    code = "E-EMERGENCY-STOP"

    def __init__(self, cell: str, by: str, reason: str) -> None:
        self.cell = cell
        self.by = by
        self.reason = reason
        super().__init__(
            f"emergency stop of {cell} by {by}" + (f" ({reason})" if reason else ""),
            expected="the robot holds its pose until it is reset",
            action=f"when it is safe to move, run: legato reset --cell {cell}",
        )


class StaleCommand(SafetyError):
    """Real time: no joint command that is young enough; the robot was braked."""

    code = "E-STALE-COMMAND"

    def __init__(self, age_s: float, limit_s: float) -> None:
        self.age_s = age_s
        self.limit_s = limit_s
        super().__init__(
            f"the newest joint command is {1e3 * age_s:.0f} ms old",
            expected=f"expected one of the last {1e3 * limit_s:.0f} ms",
            action="look at the retargeter and the link to it; the robot holds its pose",
        )
