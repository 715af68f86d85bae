"""Results that cannot be read or written."""

from __future__ import annotations

from common.errors.base import LegatoError


class StoreError(LegatoError):
    """Results that cannot be read or written."""

    code = "E-STORE"


class NotFound(StoreError):
    """An evaluation or picture that does not exist."""

    code = "E-NOT-FOUND"
    http_status = 404

    def __init__(self, kind: str, identifier: str, *, listed_at: str | None = None) -> None:
        self.kind = kind
        self.identifier = identifier
        super().__init__(
            f'no {kind} "{identifier}"',
            expected=f"expected the id of an existing {kind}",
            action=f"list them with: GET {listed_at or f'/api/v1/{kind}s'}",
        )


class NotWritable(StoreError):
    """A database or folder that cannot be written."""

    code = "E-NOT-WRITABLE"

    def __init__(self, path: str, problem: str) -> None:
        self.path = path
        self.problem = problem
        super().__init__(
            f"cannot write {path}: {problem}",
            expected="expected a writable file in an existing folder",
            action="correct the permissions or choose another --data folder",
        )
