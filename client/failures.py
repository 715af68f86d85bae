"""Errors as the command line shows them: one line each, and an exit code."""

from __future__ import annotations

from client.errors import RestError, UnknownNames
from common.errors import ConfigError, LegatoError, UnknownName


def format_error(error: LegatoError) -> str:
    """One line `E-CODE  happened; expected; action`; one line per name for unknown names."""
    if isinstance(error, UnknownNames):
        return "\n".join(_format_unknown(each) for each in error.errors)
    if isinstance(error, UnknownName):
        return _format_unknown(error)
    parts = error.describe()
    line = f"{parts['code']}  {parts['happened']}; {parts['expected']}; {parts['action']}"
    if isinstance(error, RestError):
        for each in error.problem.errors:
            line += "\n  " + ": ".join(str(value) for value in each.values())
    return line


def exit_code_of(error: LegatoError) -> int:
    """2 for wrong use, 1 for what could not run."""
    if isinstance(error, RestError):
        return 2 if error.problem.status in (400, 422) else 1
    return 2 if isinstance(error, ConfigError) else 1


def _format_unknown(error: UnknownName) -> str:
    happened = f'no {error.kind} "{error.name}"'
    meant = f"did you mean: {error.suggestion}" if error.suggestion else ""
    return f"{error.code}  {happened:<18} {meant:<24}  ({', '.join(error.known)})"
