"""Errors of the client side; they belong to the tree of `common.errors`.

LegatoError
├─ RestError                 what the control plane answered, with its own code
├─ ConfigError  WrongUse, UnknownNames
└─ LinkError    ControlUnreachable, NotLegato, ProcessGaveUp, NodesMissing
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from common.errors import ConfigError, LegatoError, LinkError, UnknownName

if TYPE_CHECKING:
    from common.api import ProblemDetails


class RestError(LegatoError):
    """The control plane refused a request; `problem` is its answer, `describe` keeps its code."""

    code = "E-REST"

    def __init__(self, problem: ProblemDetails) -> None:
        self.problem = problem
        super().__init__(problem.detail, expected=problem.expected, action=problem.action)

    def describe(self) -> dict[str, str]:
        """Give the parts of the error, with the code that the control plane gave."""
        return super().describe() | {"code": self.problem.code}


class WrongUse(ConfigError):
    """Arguments that the command line does not understand."""

    code = "E-USAGE"

    def __init__(self, command: str, problem: str, *, expected: str | None = None) -> None:
        self.command = command
        self.problem = problem
        super().__init__(
            problem,
            expected=expected or "expected the options of the help",
            action=f"run: {command} --help",
        )


class UnknownNames(ConfigError):
    """Every name of a request that does not exist, so that all are corrected at once."""

    code = UnknownName.code

    def __init__(self, errors: Sequence[UnknownName]) -> None:
        self.errors = tuple(errors)
        super().__init__(
            "; ".join(error.happened for error in errors),
            expected="; ".join(error.expected for error in errors),
            action="; ".join(error.action for error in errors),
        )


class ControlUnreachable(LinkError):
    """Nothing answers where the control plane should be."""

    code = "E-CONTROL"

    def __init__(self, url: str, problem: str) -> None:
        self.url = url
        self.problem = problem
        super().__init__(
            f"no control plane at {url} ({problem})",
            expected="expected a running LEGATO control plane",
            action="run: legato up",
        )


class NotLegato(LinkError):
    """Something answers at the URL, but not as a LEGATO control plane of this version would."""

    code = "E-NOT-LEGATO"

    def __init__(self, url: str, problem: str) -> None:
        self.url = url
        self.problem = problem
        super().__init__(
            f"{url} answered {problem}",
            expected="expected a LEGATO control plane of this version",
            action="check --url",
        )


class ProcessGaveUp(LinkError):
    """A service that ended with an error each time it was started."""

    code = "E-GAVE-UP"

    def __init__(self, last_lines: Mapping[str, str], logs: str) -> None:
        self.last_lines = dict(last_lines)
        self.logs = logs
        told = "; ".join(f"{node}: {line or 'no output'}" for node, line in last_lines.items())
        super().__init__(
            f"{', '.join(last_lines)} did not start ({told})",
            expected="expected every service to keep running",
            action=f"look at the logs in {logs}",
        )


class NodesMissing(LinkError):
    """Services that were started and are not alive in time."""

    code = "E-NODES-MISSING"

    def __init__(self, missing: Sequence[str], after_s: float, tails: Mapping[str, str]) -> None:
        self.missing = tuple(missing)
        self.after_s = after_s
        self.tails = dict(tails)
        told = "".join(f"\n  {node}: {line}" for node, line in tails.items() if line)
        super().__init__(
            f"{', '.join(missing)} not alive after {after_s:.0f} s",
            expected="expected every service to be ready",
            action=f"look at the logs{told}",
        )
