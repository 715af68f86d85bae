"""`legato certs create`, `add`, `list` and `revoke`."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from client.certificates import create_authority, open_authority, router_folder
from client.commands import CertsAdd, CertsCreate, CertsList, CertsRevoke
from client.issued import list_issued
from client.tables import format_table
from common.bus.access import ROLES, Role, role_named
from common.bus.grants import FILE, CellPattern, Grant, now, revoke_grant
from common.errors import InvalidValue, NotRevocable
from common.messages.base import Name

_USES = {
    "router": "router",
    "expert": "policy service that also runs the scripted expert",
    "viewer": "legato topic, which only listens",
}
LONGEST_DAYS = 3650


def create(command: CertsCreate) -> int:
    """Make an authority and a certificate per role; say what goes where."""
    days = _days(command.days)
    create_authority(command.out, hosts=command.host, days=days)
    _tell([(command.out / role.name, role.name) for role in ROLES])
    sys.stdout.write(
        f"valid for {days} days; keep {command.out / 'ca.key'} where no service runs: "
        "whoever has it can be any role\n"
        f"containers run as user 10001: sudo chown 10001 {command.out}/*/key.pem\n"
    )
    return 0


def add(command: CertsAdd) -> int:
    """Make one more certificate; say what goes where."""
    role, name, days = (
        role_named(command.role),
        _name(command.name or command.role),
        _days(command.days),
    )
    authority = open_authority(command.out)
    if command.cell:
        folder = authority.issue_for(_grant(command, role), days=days)
    else:
        folder = authority.issue(role, name=name, hosts=command.host, days=days)
    _tell([(folder, role.name)])
    if command.cell or (role.name == "router" and (router_folder(command.out) / FILE).exists()):
        _tell_routers(command.out)
    return 0


def show_all(command: CertsList) -> int:
    """Show who has a certificate."""
    issued = list_issued(command.out)
    if command.json:
        shown = [
            {
                "name": each.name,
                "role": each.role,
                "cells": list(each.cells),
                "expires": each.expires and each.expires.isoformat(),
                "revoked": each.revoked and each.revoked.isoformat(),
            }
            for each in issued
        ]
        sys.stdout.write(json.dumps({"certificates": shown}) + "\n")
        return 0
    rows = [
        (
            *(each.name, each.role or "unknown", " ".join(each.cells) or "none"),
            *(
                _day(each.expires) if each.expires else "?",
                _day(each.revoked) if each.revoked else "-",
            ),
        )
        for each in issued
    ]
    sys.stdout.write(format_table(("name", "role", "cells", "expires", "revoked"), rows) + "\n")
    return 0


def revoke(command: CertsRevoke) -> int:
    """Take the rights of a certificate away; say what makes it true."""
    named = [each for each in list_issued(command.out) if each.name == command.name]
    if named and all(each.grant is None for each in named):
        raise NotRevocable(command.name, named[0].role or "nobody")
    revoke_grant(router_folder(command.out), command.name)
    sys.stdout.write(f"revoked {command.name}: it may do nothing once the router has read this\n")
    _tell_routers(command.out)
    return 0


def _grant(command: CertsAdd, role: Role) -> Grant:
    if not role.per_cell:
        known = ", ".join(each.name for each in ROLES if each.per_cell)
        raise InvalidValue(
            "--cell", list(command.cell), f"no cell: only {known} can have some only"
        )
    if command.host:
        raise InvalidValue("--host", list(command.host), "no host: only routers are called by name")
    if command.name is None or any(each.name == command.name for each in ROLES):
        raise InvalidValue(
            "--name", command.name, "a name of its own, by which the router knows it"
        )
    cells = tuple(_cell(cell) for cell in command.cell)
    return Grant(name=_name(command.name), role=role.name, cells=cells, created=now())


def _cell(cell: str) -> str:
    try:
        return TypeAdapter[str](CellPattern).validate_python(cell)
    except ValidationError as error:
        expected = "a cell, with * at its end all that begin so, or * for all"
        raise InvalidValue("--cell", cell, expected) from error


def _tell_routers(folder: Path) -> None:
    file = router_folder(folder) / FILE
    sys.stdout.write(
        f"the router reads {file} when it starts: start it again, and if its certificate lies "
        "elsewhere, copy this file beside it before\n"
    )


def _day(moment: datetime) -> str:
    return f"{moment:%Y-%m-%d}"


def _tell(made: Sequence[tuple[Path, str]]) -> None:
    rows = [
        (str(folder), _USES.get(role, f"{role} service"), f"--certs {folder}")
        for folder, role in made
    ]
    table = format_table(("copy this folder", "to the machine of the", "and start it with"), rows)
    sys.stdout.write(f"{table}\nall but the router also with --endpoint tls/HOST:PORT\n")


def _name(name: str) -> str:
    try:
        return TypeAdapter(Name).validate_python(name)
    except ValidationError as error:
        raise InvalidValue("--name", name, "letters, digits, - and _") from error


def _days(days: int) -> int:
    if not 1 <= days <= LONGEST_DAYS:
        raise InvalidValue("--days", days, f"1 to {LONGEST_DAYS}")
    return days
