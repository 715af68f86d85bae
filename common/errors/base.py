"""The root of all errors."""

from __future__ import annotations

from typing import ClassVar


class LegatoError(Exception):
    """Root of every error that LEGATO raises on purpose."""

    code: ClassVar[str] = "E-LEGATO"
    http_status: ClassVar[int] = 500

    def __init__(self, happened: str, *, expected: str, action: str) -> None:
        self.happened = happened
        self.expected = expected
        self.action = action
        super().__init__(f"{happened}; {expected}; {action}")

    def describe(self) -> dict[str, str]:
        """Give the parts of the error as data, for any edge."""
        return {
            "code": self.code,
            "happened": self.happened,
            "expected": self.expected,
            "action": self.action,
        }
