"""A call that its caller may not make."""

from __future__ import annotations

from common.errors.base import LegatoError


class AccessError(LegatoError):
    """A call that its caller may not make."""

    code = "E-ACCESS"
    http_status = 403


class KeyRefused(AccessError):
    """No API key, or not one that counts."""

    code = "E-KEY"
    http_status = 401

    def __init__(self, problem: str) -> None:
        self.problem = problem
        super().__init__(
            problem,
            expected="expected the header Authorization: Bearer KEY of a key that counts",
            action="for the command legato: set LEGATO_API_KEY or LEGATO_API_KEY_FILE",
        )


class RoleTooLow(AccessError):
    """A key that may do less than this."""

    code = "E-ROLE"

    def __init__(self, name: str, role: str, needed: str) -> None:
        self.name = name
        self.role = role
        self.needed = needed
        super().__init__(
            f"the key {name} has the role {role}",
            expected=f"expected the role {needed}",
            action="use a key of that role",
        )


class ForeignPage(AccessError):
    """A web page of elsewhere that calls without a key, by the browser of someone who may."""

    code = "E-ORIGIN"

    def __init__(self, origin: str) -> None:
        self.origin = origin
        super().__init__(
            f"a page of {origin} made this call",
            expected="expected a page of this machine, as there are no keys",
            action="close that page; pages of other machines need --api-keys-file",
        )


class TooManyCalls(AccessError):
    """More writing calls of one caller than the control plane takes."""

    code = "E-TOO-MANY-CALLS"
    http_status = 429

    def __init__(self, caller: str, rate_hz: float, retry_after_s: int) -> None:
        self.caller = caller
        self.rate_hz = rate_hz
        self.retry_after_s = retry_after_s
        super().__init__(
            f"too many calls by {caller}",
            expected=f"expected at most {rate_hz:g} writing calls a second",
            action=f"wait {retry_after_s} s",
        )
