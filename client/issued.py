"""The certificates in an authority's folder, and what each may do."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from client.certificates import read_certificate, router_folder
from common.bus.access import ROLES
from common.bus.grants import Grant, read_grants
from common.errors import InvalidValue


@dataclass(frozen=True)
class Issued:
    """One certificate.

    Args:
        name: Its folder.
        role: Its role; None: one that the router does not know.
        grant: Its rights in some cells; None: those of its role in all of them.
        expires: Until when it is valid; None: it is not in the authority's folder any more.
    """

    name: str
    role: str | None
    grant: Grant | None
    expires: datetime | None

    @property
    def cells(self) -> tuple[str, ...]:
        """Cells in which it has rights."""
        if self.grant is not None:
            return self.grant.cells
        return ("*",) if self.role is not None else ()

    @property
    def revoked(self) -> datetime | None:
        """Since when it may do nothing."""
        return None if self.grant is None else self.grant.revoked


def list_issued(folder: Path) -> list[Issued]:
    """Every certificate of an authority, by name.

    Raises:
        InvalidValue: There is no authority in the folder.
        BadCertificate: One cannot be read.
        BadGrants: The router's file of rights cannot be used.
    """
    if not (folder / "ca.pem").is_file():
        raise InvalidValue("--out", str(folder), "the folder that `legato certs create` made")
    grants = {grant.name: grant for grant in read_grants(router_folder(folder)).grants}
    found = [_read(path, grants) for path in folder.glob("*/cert.pem")]
    kept = {each.grant.name for each in found if each.grant is not None}
    gone = [
        Issued(name, grant.role, grant, None) for name, grant in grants.items() if name not in kept
    ]
    return sorted([*found, *gone], key=lambda each: each.name)


def _read(path: Path, grants: dict[str, Grant]) -> Issued:
    common_name, expires = read_certificate(path)
    grant = grants.get(common_name)
    if grant is not None:
        return Issued(path.parent.name, grant.role, grant, expires)
    known = any(role.name == common_name for role in ROLES)
    return Issued(path.parent.name, common_name if known else None, None, expires)
