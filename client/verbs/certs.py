"""`legato certs create` and `add`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from client.certificates import create_authority, open_authority
from client.commands import CertsAdd, CertsCreate
from client.tables import format_table
from common.bus.access import ROLES, role_named
from common.errors import InvalidValue
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
    role, name = role_named(command.role), _name(command.name or command.role)
    folder = open_authority(command.out).issue(
        role, name=name, hosts=command.host, days=_days(command.days)
    )
    _tell([(folder, role.name)])
    return 0


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
