"""What a check found, as text and as data."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

Value: TypeAlias = float | str | Mapping[str, float]
Status = Literal["ok", "problem", "skipped"]


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One thing that was looked at."""

    group: str
    """What it belongs to: kinematics, ranges, masses, legs, reach, margins."""
    name: str
    status: Status
    text: str
    """For people, with numbers; names the body or joint."""
    values: Mapping[str, Value] = field(default_factory=dict[str, Value])
    """The numbers, with their units in the names; of one joint in [rad, m]."""


def judge(good: bool) -> Status:
    """`ok` or `problem`."""
    return "ok" if good else "problem"


@dataclass(frozen=True, kw_only=True)
class RobotReport:
    """All findings on one robot."""

    robot: str
    title: str
    findings: Sequence[Finding]

    @property
    def problems(self) -> int:
        """How many findings are problems."""
        return sum(finding.status == "problem" for finding in self.findings)

    def to_json(self) -> dict[str, Any]:
        """As data; None where a joint has no limit to be near to."""
        return {
            "robot": self.robot,
            "title": self.title,
            "ok": not self.problems,
            "findings": [_without_infinity(dataclasses.asdict(each)) for each in self.findings],
        }

    def to_text(self) -> str:
        """One line per finding, under the name of its group; the sum of it last."""
        lines = [f"{self.robot}: {self.title}"]
        group = ""
        width = max((len(finding.name) for finding in self.findings), default=0)
        for finding in self.findings:
            if finding.group != group:
                group = finding.group
                lines += ["", group]
            lines.append(f"  {finding.status:<7}  {finding.name:<{width}}  {finding.text}")
        told = {0: "no problem", 1: "1 problem"}.get(self.problems, f"{self.problems} problems")
        return "\n".join([*lines, "", told]) + "\n"


def _without_infinity(value: Any) -> Any:
    """The same structure with None for every number that JSON cannot say."""
    if isinstance(value, dict):
        return {key: _without_infinity(each) for key, each in value.items()}
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
