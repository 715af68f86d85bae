"""`legato keys create`, `list` and `revoke`."""

from __future__ import annotations

import json
import sys

from pydantic import TypeAdapter, ValidationError

from client.commands import KeysCreate, KeysList, KeysRevoke
from client.tables import format_table
from common.errors import InvalidValue
from common.keys import Role, create_key, read_keys, revoke_key
from common.messages.base import Name


def create(command: KeysCreate) -> int:
    """Make a key and print it alone, so that a shell can take it."""
    try:
        name = TypeAdapter[str](Name).validate_python(command.name)
    except ValidationError as error:
        expected = "letters, digits and . _ @ -, at most 64"
        raise InvalidValue("--name", command.name, expected) from error
    key = create_key(command.file, name=name, role=Role(command.role))
    sys.stdout.write(f"{key}\n")
    sys.stderr.write(f"shown once; {command.file} keeps its hash only\n")
    return 0


def show_all(command: KeysList) -> int:
    """Show who has a key."""
    keys = read_keys(command.file).keys
    if command.json:
        shown = [key.model_dump(mode="json", exclude={"sha256"}) for key in keys]
        sys.stdout.write(json.dumps({"keys": shown}) + "\n")
    else:
        rows = [(key.name, key.role, f"{key.created:%Y-%m-%d %H:%M:%S} UTC") for key in keys]
        sys.stdout.write(format_table(("name", "role", "created"), rows) + "\n")
    return 0


def revoke(command: KeysRevoke) -> int:
    """Remove a key."""
    revoke_key(command.file, name=command.name)
    sys.stdout.write(f"revoked {command.name}\n")
    return 0
