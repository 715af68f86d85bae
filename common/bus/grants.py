"""Rights in some cells only, for certificates with a name of their own.

The router reads them from a file in its folder. A name that was revoked stays in there: the
certificate lives on, so nobody may ever be given that name again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Literal, Self, TypeVar

from pydantic import (
    AwareDatetime,
    BaseModel,
    ConfigDict,
    Field,
    StringConstraints,
    ValidationError,
    field_validator,
    model_validator,
)

from common.bus.access import ROLES
from common.errors import BadGrants, InvalidValue, UnknownName
from common.files import lock_folder, replace_file
from common.messages.base import Name

FILE = "grants.json"
"""In the router's folder: everybody's rights."""
OWN_FILE = "grant.json"
"""In the folder of a certificate: its own rights, for its process to know."""

CellPattern = Annotated[
    str, StringConstraints(pattern=r"^([A-Za-z0-9][A-Za-z0-9_.@-]{0,63}\*?|\*)$")
]
"""Name of a cell; with a `*` at its end, of all cells whose names begin so; `*`: of all."""

_CONFIG = ConfigDict(extra="forbid", frozen=True)


class Grant(BaseModel):
    """What one certificate may do: what its role may, in some cells.

    Args:
        name: Common name of the certificate.
        role: Its role.
        cells: Cells whose messages it may hear and send.
        created: When the certificate was made.
        revoked: Since when it may do nothing.
    """

    model_config = _CONFIG

    name: Name
    role: str
    cells: Annotated[tuple[CellPattern, ...], Field(min_length=1)]
    created: AwareDatetime
    revoked: AwareDatetime | None = None

    @field_validator("name")
    @classmethod
    def _is_no_role(cls, name: str) -> str:
        if any(role.name == name for role in ROLES):
            raise ValueError(f"{name} is a role")
        return name

    @field_validator("role")
    @classmethod
    def _can_be_limited(cls, role: str) -> str:
        known = [each.name for each in ROLES if each.per_cell]
        if role not in known:
            raise ValueError(f"{role} is none of {', '.join(known)}")
        return role


class Grants(BaseModel):
    """Everybody's rights in some cells, also those that were revoked."""

    model_config = _CONFIG

    version: Literal[1] = 1
    grants: tuple[Grant, ...] = ()

    @model_validator(mode="after")
    def _names_differ(self) -> Self:
        if len({grant.name for grant in self.grants}) < len(self.grants):
            raise ValueError("two grants have one name")
        return self

    @property
    def live(self) -> tuple[Grant, ...]:
        """Those that were not revoked."""
        return tuple(grant for grant in self.grants if grant.revoked is None)


File = TypeVar("File", Grant, Grants)


def includes(cells: Iterable[str], cell: str) -> bool:
    """Whether one of the patterns is, or includes, the name of a cell."""
    return any(
        cell.startswith(pattern[:-1]) if pattern.endswith("*") else cell == pattern
        for pattern in cells
    )


def check_cell(cell: str | None, cells: Sequence[str]) -> None:
    """Refuse the owner of a cell in which its certificate has no rights.

    Raises:
        InvalidValue: The cell is none of those.
    """
    if cell is not None and not includes(cells, cell):
        raise InvalidValue(
            "--node", cell, f"one of the cells of its certificate: {', '.join(cells)}"
        )


def read_grants(folder: Path) -> Grants:
    """Rights that a router's folder has; without the file, nobody's.

    Raises:
        BadGrants: The file cannot be read, or is not one of rights.
    """
    return _read(folder / FILE, Grants) or Grants()


def read_own(folder: Path) -> Grant | None:
    """Rights that came with a certificate; None: those of its role in all cells.

    Raises:
        BadGrants: The file cannot be read, or is not one of rights.
    """
    return _read(folder / OWN_FILE, Grant)


def add_grant(folder: Path, grant: Grant, *, issue: Callable[[], Path]) -> Path:
    """Make a certificate and write its rights beside it, and in the router's folder.

    Args:
        folder: The router's.
        grant: The rights.
        issue: Makes the certificate's folder and returns it. Its rights come last: until then, and
            if it fails, nothing is allowed.

    Raises:
        BadGrants: The file is not one of rights, or cannot be written.
        InvalidValue: It has this name already.
    """
    made: list[Path] = []

    def add(before: Grants) -> Grants:
        if any(each.name == grant.name for each in before.grants):
            raise InvalidValue("--name", grant.name, f"a name that {folder / FILE} never had")
        made.append(issue())
        replace_file(made[0] / OWN_FILE, grant.model_dump_json(indent=2) + "\n", mode=0o644)
        return Grants(grants=(*before.grants, grant))

    _change(folder, add)
    return made[0]


def revoke_grant(folder: Path, name: str) -> None:
    """Take the rights of a certificate away for good.

    Args:
        folder: The router's.
        name: Common name of the certificate.

    Raises:
        BadGrants: The file is not one of rights, or cannot be written.
        InvalidValue: That was done before.
        UnknownName: It has no such name.
    """

    def revoke(before: Grants) -> Grants:
        known = {grant.name: grant for grant in before.grants}
        if name not in known:
            raise UnknownName("certificate with --cell", name, list(known))
        since = known[name].revoked
        if since is not None:
            raise InvalidValue("NAME", name, f"one that is not revoked since {since:%Y-%m-%d}")
        known[name] = known[name].model_copy(update={"revoked": now()})
        return Grants(grants=tuple(known.values()))

    _change(folder, revoke)


def now() -> datetime:
    """This second, as it stands in the file."""
    return datetime.now(UTC).replace(microsecond=0)


def _read(path: Path, kind: type[File]) -> File | None:
    try:
        return kind.model_validate_json(path.read_bytes())
    except FileNotFoundError:
        return None
    except OSError as error:
        raise BadGrants(str(path), error.strerror or str(error)) from error
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(str(part) for part in first["loc"]) or "file"
        raise BadGrants(str(path), f"{where}: {first['msg']}") from error


def _change(folder: Path, change: Callable[[Grants], Grants]) -> None:
    """Replace the file in one step; who changes it at the same time waits."""
    try:
        with lock_folder(folder):
            after = change(read_grants(folder))
            replace_file(folder / FILE, after.model_dump_json(indent=2) + "\n", mode=0o644)
    except OSError as error:
        raise BadGrants(str(folder / FILE), error.strerror or str(error)) from error
