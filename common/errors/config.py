"""What was asked for cannot be meant."""

from __future__ import annotations

import difflib
from collections.abc import Sequence

from common.errors.base import LegatoError


class ConfigError(LegatoError):
    """What was asked for cannot be meant."""

    code = "E-CONFIG"
    http_status = 422


class UnknownName(ConfigError):
    """A task, robot, policy, camera or topic that does not exist."""

    code = "E-UNKNOWN-NAME"

    def __init__(self, kind: str, name: str, known: Sequence[str]) -> None:
        self.kind = kind
        self.name = name
        self.known = tuple(known)
        close = difflib.get_close_matches(name, self.known, n=1, cutoff=0.5)
        self.suggestion = close[0] if close else None
        super().__init__(
            f'no {kind} "{name}"',
            expected=f"known: {', '.join(self.known) or 'none'}",
            action=f"did you mean: {self.suggestion}" if self.suggestion else "use a known name",
        )


class InvalidValue(ConfigError):
    """A value outside what the field allows."""

    code = "E-INVALID-VALUE"

    def __init__(self, field: str, value: object, expected: str) -> None:
        self.field = field
        self.value = value
        super().__init__(
            f"{field} is {value!r}", expected=f"expected {expected}", action=f"change {field}"
        )


class BadCertificate(ConfigError):
    """A certificate or key that is missing, cannot be read, or is not valid."""

    code = "E-CERTIFICATE"

    def __init__(self, path: str, problem: str) -> None:
        self.path = path
        self.problem = problem
        super().__init__(
            f"{path}: {problem}",
            expected="expected ca.pem, cert.pem and key.pem of one role, readable and valid now",
            action="copy the role's folder again, or make it with: legato certs (docs/security.md)",
        )


class MissingExtra(ConfigError):
    """A third-party package that an extra would have installed."""

    code = "E-MISSING-EXTRA"

    def __init__(self, package: str, extra: str) -> None:
        self.package = package
        self.extra = extra
        super().__init__(
            f"the package {package} is not installed",
            expected=f"it comes with the extra [{extra}]",
            action=f"run: pip install 'legato[{extra}]'",
        )


class MissingProgram(ConfigError):
    """A program of the machine that is needed and not there."""

    code = "E-MISSING-PROGRAM"

    def __init__(self, program: str, wanted: str) -> None:
        self.program = program
        super().__init__(
            f"there is no {program} on the PATH",
            expected=f"expected {wanted}",
            action=f"install it, or do without what needs {program}",
        )


class UntrainedTask(ConfigError):
    """A policy that was not trained for the task."""

    code = "E-UNTRAINED-TASK"

    def __init__(self, policy: str, task: str, tasks: Sequence[str]) -> None:
        self.policy = policy
        self.task = task
        self.tasks = tuple(tasks)
        super().__init__(
            f'the policy {policy} was not trained for the task "{task}"',
            expected=f"trained for: {', '.join(tasks)}",
            action="choose another policy or another task",
        )


class BadKeyFile(ConfigError):
    """A file of API keys that cannot be used."""

    code = "E-KEY-FILE"

    def __init__(self, path: str, problem: str) -> None:
        self.path = path
        self.problem = problem
        super().__init__(
            f"keys in {path}: {problem}",
            expected="expected a file as `legato keys create` makes it",
            action="correct the path, the permissions or the file",
        )


class BadGrants(ConfigError):
    """A file of rights in some cells that cannot be used."""

    code = "E-GRANTS"

    def __init__(self, path: str, problem: str) -> None:
        self.path = path
        self.problem = problem
        super().__init__(
            f"rights in {path}: {problem}",
            expected="expected a file as `legato certs add --cell` and `revoke` write it",
            action="correct the path or the permissions, or bring back a copy (docs/security.md)",
        )


class NotRevocable(ConfigError):
    """A certificate that the router cannot tell from others of its role."""

    code = "E-NOT-REVOCABLE"

    def __init__(self, name: str, role: str) -> None:
        self.name = name
        self.role = role
        super().__init__(
            f"the certificate {name} is one of many with the rights of {role}",
            expected="expected one that was made with --cell, which has a name of its own",
            action="make a new authority (legato certs create --out NEW), give every process "
            "its folder from there and start all again (docs/security.md)",
        )


class Exposed(ConfigError):
    """A listener that others could reach without saying who they are."""

    code = "E-EXPOSED"

    def __init__(self, what: str, host: str, *, protection: str, consent: str) -> None:
        self.what = what
        self.host = host
        self.protection = protection
        self.consent = consent
        super().__init__(
            f"{what} at {host or 'every address'} would be open to whoever reaches it",
            expected=f"expected {protection}, or an address of this machine alone (127.0.0.1)",
            action=f"give one of them, or {consent} if something else keeps others out",
        )
